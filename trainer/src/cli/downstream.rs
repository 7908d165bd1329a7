//! `downstream`: what labelled scans are worth to a network that learns from them.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use trainer::backend::Backend;
use trainer::segmentation::SegmentationConfig;
use trainer::segmentation::downstream::{Question, downstream};

#[derive(Debug, Args)]
pub(super) struct DownstreamArgs {
    /// Folders of labelled scans; each is learned from alone.
    #[arg(required = true)]
    folders: Vec<PathBuf>,
    /// Folder of labelled real scans to be scored on.
    #[arg(long)]
    real: PathBuf,
    /// Size and budget of the networks (TOML); which scans it names does not matter here.
    #[arg(long, default_value = "trainer/configs/segmentation.toml")]
    config: PathBuf,
    /// Networks a folder.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=100))]
    seeds: u64,
    /// Have networks see no reflectances, neither of the folders' scans nor of the real ones.
    #[arg(long)]
    without_reflectance: bool,
    /// What computes the steps, in the place of what the config says.
    #[arg(long, value_enum)]
    backend: Option<Backend>,
}

impl DownstreamArgs {
    pub(super) fn run(&self) -> Result<()> {
        let mut config = SegmentationConfig::read(&self.config)?;
        config.backend = self.backend.unwrap_or(config.backend);
        let question = Question {
            real: self.real.clone(),
            seeds: (1..=self.seeds).collect(),
            reflectance: !self.without_reflectance,
        };
        println!("{}", downstream(&config, &self.folders, &question)?);
        Ok(())
    }
}
