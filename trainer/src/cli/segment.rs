//! `segment`: the network whose features scans are compared by, trained and scored.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use trainer::segmentation::{SegmentationConfig, train};

#[derive(Debug, Args)]
pub(super) struct SegmentArgs {
    /// The network's config (TOML).
    config: PathBuf,
    /// Folder that the config's data paths are relative to.
    #[arg(long, default_value = ".")]
    data: PathBuf,
    /// Folder for the weights and their card.
    #[arg(long, default_value = "models/segmentation/1")]
    out: PathBuf,
}

impl SegmentArgs {
    pub(super) fn run(&self) -> Result<()> {
        let mut trained = train::train(&SegmentationConfig::read(&self.config)?, &self.data)?;
        trained.save(&self.out)?;
        println!("{}\n{}", self.out.display(), trained.card.to_markdown());
        Ok(())
    }
}
