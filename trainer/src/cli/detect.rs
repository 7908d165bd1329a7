//! `detect`: what labelled scans are worth to a vehicle detector that sees them from above.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use trainer::backend::Backend;
use trainer::birds_eye::BirdsEyeConfig;
use trainer::birds_eye::detection::{Question, detection};

#[derive(Debug, Args)]
pub(super) struct DetectArgs {
    /// Folders of labelled scans; each is learned from alone.
    #[arg(required = true)]
    folders: Vec<PathBuf>,
    /// Folder of labelled real scans to be scored on.
    #[arg(long)]
    real: PathBuf,
    /// Run of a translation from above: each folder is also learned from as it makes it. May be given several times.
    #[arg(long)]
    through: Vec<PathBuf>,
    /// What detectors see, their size and budget (TOML); which scans it names does not matter here.
    #[arg(long, default_value = "trainer/configs/birds-eye/cyclegan.toml")]
    config: PathBuf,
    /// Detectors a folder.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=100))]
    seeds: u64,
    /// PNG to write: a real scan's vehicles by its labels, and as the last detector found them.
    #[arg(long)]
    picture: Option<PathBuf>,
    /// What computes the steps, in the place of what the config says.
    #[arg(long, value_enum)]
    backend: Option<Backend>,
}

impl DetectArgs {
    pub(super) fn run(&self) -> Result<()> {
        let mut config = BirdsEyeConfig::read(&self.config)?;
        config.backend = self.backend.unwrap_or(config.backend);
        let question =
            Question { real: self.real.clone(), through: self.through.clone(), seeds: (1..=self.seeds).collect() };
        let answer = detection(&config, &self.folders, &question)?;
        println!("{}", answer.table);
        if let Some(path) = &self.picture {
            lidar::formats::write_atomically(path, &answer.picture)?;
        }
        Ok(())
    }
}
