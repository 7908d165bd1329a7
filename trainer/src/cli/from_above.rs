//! `from-above`: scans as they are seen from above, as files.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use trainer::birds_eye::{BirdsEyeConfig, dataset};

#[derive(Debug, Args)]
pub(super) struct FromAboveArgs {
    /// Folder of scans, or a file.
    scans: PathBuf,
    /// Folder to write to: an array, the vehicles and a picture of each.
    out: PathBuf,
    /// Run of a translation from above: scans are written as it makes them.
    #[arg(long)]
    through: Option<PathBuf>,
    /// What is seen (TOML); which scans it names does not matter here.
    #[arg(long, default_value = "trainer/configs/birds-eye/cyclegan.toml")]
    config: PathBuf,
}

impl FromAboveArgs {
    pub(super) fn run(&self) -> Result<()> {
        let config = BirdsEyeConfig::read(&self.config)?;
        for path in dataset::write(&config, &self.scans, self.through.as_deref(), &self.out)? {
            println!("{}", path.display());
        }
        Ok(())
    }
}
