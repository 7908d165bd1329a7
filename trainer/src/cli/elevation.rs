//! `elevation`: by how much a sensor's rays point higher than it says, from the ground in its scans.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use lidar::formats::{self, Limits};
use lidar::{Projector, RangeImage, Sensor};
use rayon::prelude::*;
use trainer::closed_loop::ground;
use trainer::config::load_sensor;
use trainer::data::scans::scan_files;

/// Blocks of consecutive scans that the standard error takes for independent.
const BLOCKS: usize = 10;

#[derive(Debug, Args)]
pub(super) struct ElevationArgs {
    /// Scans of one drive, or folders of them, in the order in which they were taken.
    #[arg(required = true)]
    scans: Vec<PathBuf>,
    /// Name of a built-in sensor, or path of a sensor's TOML file, such as `sensor --out` writes.
    #[arg(long)]
    sensor: String,
}

impl ElevationArgs {
    pub(super) fn run(&self) -> Result<()> {
        let sensor = load_sensor(&self.sensor)?;
        let mut files = Vec::new();
        for path in &self.scans {
            files.extend(scan_files(path)?);
        }
        ensure!(files.len() > 1, "{} scan: ground has to be seen from two places", files.len());
        let images: Vec<RangeImage> =
            files.par_iter().map(|file| read(file.as_path(), &sensor)).collect::<Result<_>>()?;
        let block = images.len().div_ceil(BLOCKS);
        let scans: Vec<(usize, &RangeImage)> = images.iter().enumerate().map(|(i, image)| (i / block, image)).collect();
        for sentence in ground::measure(&scans, &sensor).sentences() {
            println!("{sentence}");
        }
        Ok(())
    }
}

fn read(file: &std::path::Path, sensor: &Sensor) -> Result<RangeImage> {
    let context = || format!("scan {}", file.display());
    let cloud = formats::read(file, &Limits::default()).with_context(context)?;
    Ok(Projector::new(sensor).project(&cloud).with_context(context)?.image)
}
