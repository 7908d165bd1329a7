//! `calibrate-unpaired`: the closed loop on real scans without simulated twins.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use trainer::closed_loop::folder;
use trainer::closed_loop::unpaired::{UnpairedDelivery, compare};
use trainer::config::load_sensor;
use trainer::sets::UnpairedSet;

#[derive(Debug, Args)]
pub(super) struct UnpairedArgs {
    /// Folder of real scans, optionally with scenes.txt.
    measured: PathBuf,
    /// Folder of simulated scans of the same sensor in other places, optionally with scenes.txt.
    #[arg(long)]
    simulated: PathBuf,
    /// Name of a built-in sensor, or path of a sensor's TOML file [default: sensor.toml in or above MEASURED].
    #[arg(long)]
    sensor: Option<String>,
    /// What chance depends on: which scenes are kept back.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Folder for model.onnx, its card and the report: a new or empty one, or one of an earlier calibration, which is replaced.
    #[arg(long)]
    out: PathBuf,
}

impl UnpairedArgs {
    pub(super) fn run(&self) -> Result<()> {
        folder::check(&self.out)?;
        let sensor = self.sensor.as_deref().map(load_sensor).transpose()?;
        let set = UnpairedSet::read(&self.measured, &self.simulated, sensor.as_ref())?;
        let delivery = UnpairedDelivery::new(&set, compare(&set, self.seed), self.seed)?;
        delivery.write(&self.out)?;
        println!("{}", delivery.report.words());
        for file in folder::FILES {
            println!("{}", self.out.join(file).display());
        }
        Ok(())
    }
}
