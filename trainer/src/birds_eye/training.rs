//! A run, from its config to its best network.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use burn::tensor::Device;
use lidar::birds_eye::{BirdsEye, CHANNELS};
use likeness::pyramid::{Border, Plane};
use likeness::sliced::{LEAST, Length, Scale, Slicer, Slices};
use serde_json::json;

use super::config::BirdsEyeConfig;
use super::cycle_gan::CycleGan;
use super::sampler::Sampler;
use super::scan::{Scan, Turn};
use super::translator::Translator;
use crate::train::checkpoint::load_network;
use crate::train::run::best_of;
use crate::train::{Ending, Run, Validation, teach};

/// Names of the channels' distances.
const DISTANCES: [&str; CHANNELS] = ["SWD of heights", "SWD of reflectances", "SWD of densities"];

/// Trains a translation, and tells at the end how far the answers to the validation scans are from real ones.
pub fn train(config: &BirdsEyeConfig, run: &Run) -> Result<Option<String>> {
    let newest = run.open(&config.to_toml()?)?;
    let sampler = Sampler {
        simulated: scans(config, &run.data, &config.simulated.train)?,
        real: scans(config, &run.data, &config.real.train)?,
        grid: config.grid,
        seed: config.seed,
        batch: config.schedule.batch,
        side: config.schedule.crop_columns,
    };
    sampler.check()?;
    let mut learner = CycleGan::new(config, sampler, Examiner::load(config, &run.data)?)?;
    if teach(&mut learner, &config.schedule.plan(), run, newest.as_deref())? == Ending::Stopped {
        return Ok(None);
    }
    Ok(Some(evaluate(&run.out, &run.data)?))
}

/// How far the answers of a run's best network to the validation scans are from real ones, beside the simulation itself.
pub fn evaluate(run: &Path, data: &Path) -> Result<String> {
    let (config, translator) = best(run)?;
    Ok(Examiner::load(&config, data)?.table(&translator))
}

/// The scans of all these folders.
fn scans(config: &BirdsEyeConfig, data: &Path, folders: &[PathBuf]) -> Result<Vec<Scan>> {
    let scans = folders.iter().map(|folder| Scan::read_all(&data.join(folder), config.projector()?));
    Ok(scans.collect::<Result<Vec<_>>>()?.concat())
}

/// The config and the best network of a run.
pub fn best(run: &Path) -> Result<(BirdsEyeConfig, Translator)> {
    let config = BirdsEyeConfig::read(&run.join("config.toml"))?;
    let network = load_network(&best_of(run), config.generator.init(&Device::flex()))?;
    let translator = Translator::new(network, config.ray_drop);
    Ok((config, translator))
}

/// A run's translation, if it sees scans as the config has them seen.
pub(super) fn translator_for(run: &Path, config: &BirdsEyeConfig) -> Result<Translator> {
    let (of_run, translator) = best(run)?;
    let same = of_run.grid == config.grid && of_run.projected_by == config.projected_by;
    ensure!(same, "run {}: its grid or projected_by is not the config's", run.display());
    Ok(translator)
}

/// Scans of both domains that are not learned from.
#[derive(Debug)]
pub(super) struct Examiner {
    simulated: Vec<BirdsEye>,
    real: Vec<BirdsEye>,
    slicer: Slicer,
    real_slices: Vec<[Slices; CHANNELS]>,
    /// How far the simulation itself is from real.
    of_simulation: [f64; CHANNELS],
}

impl Examiner {
    /// With a config's validation scans.
    fn load(config: &BirdsEyeConfig, data: &Path) -> Result<Self> {
        let seen = |folders: &[PathBuf]| -> Result<Vec<BirdsEye>> {
            Ok(scans(config, data, folders)?.iter().map(|scan| scan.seen(&config.grid, Turn::default()).0).collect())
        };
        Self::new(seen(&config.simulated.validate)?, seen(&config.real.validate)?)
    }

    fn new(simulated: Vec<BirdsEye>, real: Vec<BirdsEye>) -> Result<Self> {
        let cells = real.first().context("no real scans to validate on")?.cells;
        ensure!(cells >= LEAST, "grid: {cells} cells along a side, expected {LEAST} or more");
        let slicer = Slicer::new(Border::Mirror, Length::One, 0);
        let real_slices = slices(&slicer, &real);
        let examiner = Self { of_simulation: [f64::NAN; CHANNELS], simulated, real, slicer, real_slices };
        Ok(Self { of_simulation: examiner.distances(&examiner.simulated), ..examiner })
    }

    /// Sliced Wasserstein distances of the channels' patches from those of real scans.
    fn distances(&self, scans: &[BirdsEye]) -> [f64; CHANNELS] {
        let found = slices(&self.slicer, scans);
        std::array::from_fn(|channel| {
            let of = |all: &'_ [[Slices; CHANNELS]]| all.iter().map(|scan| scan[channel].clone()).collect::<Vec<_>>();
            let (found, real) = (of(&found), of(&self.real_slices));
            self.slicer.distance(&found.iter().collect::<Vec<_>>(), &real.iter().collect::<Vec<_>>(), Scale::OfSecond)
        })
    }

    fn translated(&self, translator: &Translator) -> Vec<BirdsEye> {
        self.simulated.iter().zip(0..).map(|(scan, seed)| translator.translate(scan, seed)).collect()
    }

    /// The sum of the distances, each in units of the simulation's own.
    pub(super) fn validate(&self, translator: &Translator) -> Validation {
        let found = self.distances(&self.translated(translator));
        let total = found.iter().zip(self.of_simulation).map(|(found, own)| found / own.max(f64::EPSILON)).sum();
        let curves: Vec<(String, f64)> = DISTANCES.map(String::from).into_iter().zip(found).collect();
        Validation { total, scores: json!(curves), curves }
    }

    /// A simulated scan, the answer to it, and a real one, as PNG.
    pub(super) fn picture(&self, translator: &Translator) -> Result<Vec<u8>> {
        let simulated = &self.simulated[0];
        let answer = translator.translate(simulated, 0);
        let scans = [(simulated, "simulated"), (&answer, "translated"), (&self.real[0], "real, of another place")];
        Ok(lidar::picture::from_above(&scans.map(|(scan, caption)| (scan, &[][..], caption)))?)
    }

    fn table(&self, translator: &Translator) -> String {
        let found = self.distances(&self.translated(translator));
        let rows = DISTANCES.iter().zip(self.of_simulation.iter().zip(found));
        let rows: Vec<String> =
            rows.map(|(name, (own, found))| format!("| {name} | {own:.4} | {found:.4} |")).collect();
        format!(
            "| distance from real | simulation | translated |\n|---|---|---|\n{}\n\n{} simulated scans, {} real ones of other places, in \
             standard deviations of these.\n",
            rows.join("\n"),
            self.simulated.len(),
            self.real.len()
        )
    }
}

fn slices(slicer: &Slicer, scans: &[BirdsEye]) -> Vec<[Slices; CHANNELS]> {
    let plane = |scan: &BirdsEye, channel| Plane { columns: scan.cells, values: scan.channel(channel).to_vec() };
    let slice =
        |(number, scan): (usize, &BirdsEye)| std::array::from_fn(|channel| slicer.slice(plane(scan, channel), number));
    scans.iter().enumerate().map(slice).collect()
}
