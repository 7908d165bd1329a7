//! `compare`: how real scans look that somebody made, against scans that a sensor took.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use burn::tensor::Device;
use clap::Args;
use lidar::formats::{self, Limits};
use lidar::{Projector, RangeImage, Sensor};
use likeness::Draws;
use rayon::prelude::*;
use trainer::config::load_sensor;
use trainer::data::scans::scan_files;
use trainer::realness::report::Report;
use trainer::realness::{Judge, Protocol, realness, with_floor};
use trainer::segmentation::Segmentation;

#[derive(Debug, Args)]
pub(super) struct CompareArgs {
    /// Scans to judge: a folder, or a file.
    output: PathBuf,
    /// Real scans of the sensor, in the order in which they were taken.
    real: PathBuf,
    /// The simulated scans that OUTPUT was made from, files of the same names: says how true OUTPUT is to them.
    #[arg(long)]
    simulated: Option<PathBuf>,
    /// Other real scans, better of another drive: what they score against REAL is the floor. Without, the first half of REAL is scored
    /// against the second.
    #[arg(long)]
    floor: Option<PathBuf>,
    /// Name of a built-in sensor, or path of a sensor's TOML file.
    #[arg(long, default_value = "hdl64e")]
    sensor: String,
    /// Columns at which scans are compared; how true they are to the simulation is told at the sensor's own.
    #[arg(long, default_value_t = 1024)]
    columns: usize,
    /// The segmentation network's folder.
    #[arg(long, default_value = "models/segmentation/1")]
    segmentation: PathBuf,
    /// Whose definitions of the metrics.
    #[arg(long, value_enum, default_value_t)]
    protocol: Protocol,
    /// Draws of the bootstrap over scans; 0 = no intervals.
    #[arg(long, default_value_t = 200)]
    draws: usize,
    /// Seed of the draws.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Where to write everything as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

impl CompareArgs {
    pub(super) fn run(&self) -> Result<()> {
        let own = load_sensor(&self.sensor)?;
        let device = Device::flex();
        let segmentation = Segmentation::load(&self.segmentation, &device)?;
        let draws = Draws { count: self.draws, seed: self.seed };
        let judge = Judge {
            sensor: own.clone().with_columns(self.columns)?,
            segmentation: &segmentation,
            device,
            protocol: self.protocol,
            draws,
        };
        let read_folder = |path: &Path| read(&scan_files(path)?, &judge.sensor);
        let (outputs, real) = (read_folder(&self.output)?, read_folder(&self.real)?);
        let mut scores = match &self.floor {
            None => realness(&outputs, &real, &judge)?,
            Some(other) => {
                let real = judge.sum_up(&real)?;
                let floor = judge.score(&judge.sum_up(&read_folder(other)?)?, &real, Draws { count: 0, ..draws })?;
                with_floor(judge.score(&judge.sum_up(&outputs)?, &real, draws)?, &floor)
            }
        };
        if let Some(simulated) = &self.simulated {
            let judge = Judge { sensor: own, ..judge.clone() };
            let files = scan_files(&self.output)?;
            let twins = twins(&files, simulated)?;
            scores.extend(judge.faithfulness(&read(&files, &judge.sensor)?, &read(&twins, &judge.sensor)?)?);
        }
        let report = Report {
            output: self.output.display().to_string(),
            real: self.real.display().to_string(),
            floor: match &self.floor {
                Some(floor) => floor.display().to_string(),
                None => "first half of the real scans against the second".into(),
            },
            protocol: self.protocol,
            sensor: judge.sensor.name.clone(),
            size: [judge.sensor.rings().len(), judge.sensor.columns()],
            segmentation_sha256: segmentation.card.weights_sha256.clone(),
            draws: draws.count,
            seed: draws.seed,
            scores,
        };
        println!("{}", report.to_table());
        if let Some(path) = &self.json {
            lidar::formats::write_atomically(path, &serde_json::to_vec_pretty(&report)?)?;
        }
        Ok(())
    }
}

/// Scans as the sensor's range images.
fn read(files: &[PathBuf], sensor: &Sensor) -> Result<Vec<RangeImage>> {
    let one = |file: &PathBuf| {
        let context = || format!("scan {}", file.display());
        let cloud = formats::read(file, &Limits::default()).with_context(context)?;
        Ok(Projector::new(sensor).project(&cloud).with_context(context)?.image)
    };
    files.par_iter().map(one).collect()
}

/// For each file the one of the same name in a folder, whatever its format.
fn twins(files: &[PathBuf], folder: &Path) -> Result<Vec<PathBuf>> {
    let others = scan_files(folder)?;
    let twin = |file: &PathBuf| {
        let found = others.iter().find(|other| other.file_stem() == file.file_stem());
        found.cloned().with_context(|| format!("no scan in {} has the name of {}", folder.display(), file.display()))
    };
    files.iter().map(twin).collect()
}
