//! What scans are worth to a vehicle detector: detectors learn from each folder alone, and are scored on real scans.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams};
use burn::tensor::Device;
use lidar::birds_eye::{BirdsEye, Grid};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::config::BirdsEyeConfig;
use super::detector::{Found, SHAPE_WEIGHT, Target, detect, init, tensor};
use super::scan::{Scan, Turn};
use super::score::{Match, average_precision};
use super::training::translator_for;
use super::translator::Translator;
use super::vehicles::Vehicles;
use crate::network::Border;
use crate::seeds::{self, mean_with_interval};
use crate::segmentation::Darknet;
use crate::segmentation::train::warm_cosine;

/// Every scan is learned from as it is seen after so many turns: what a translation makes of it takes longer than a step.
const TURNS: usize = 6;

/// Centres' distances within which a vehicle counts as found: nuScenes's (Caesar et al. 2020).
const WITHIN_M: [f32; 4] = [0.5, 1.0, 2.0, 4.0];

/// Overlap at which it does.
const OVERLAP: f32 = 0.5;

/// Steps between two lines of the log.
const LOG_EVERY: usize = 50;

/// Scores below this one are not drawn.
const DRAWN: f32 = 0.3;

/// What detectors are asked.
#[derive(Clone, Debug)]
pub struct Question {
    /// Folder of the labelled real scans that they are scored on.
    pub real: PathBuf,
    /// Runs of translations; each folder is learned from as it is, and as each of these makes it.
    pub through: Vec<PathBuf>,
    /// Seeds of the detectors of each.
    pub seeds: Vec<u64>,
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Answer {
    /// The scores, as a table.
    pub table: String,
    /// PNG: the vehicles of the real scan that has most of them by its labels, and as the last detector found them.
    pub picture: Vec<u8>,
}

/// Images, each with the vehicles that it shows.
type Seen = Vec<(BirdsEye, Vehicles)>;

/// Trains a detector of the config's size and budget on each folder, and on what each run makes of it, with each seed; scores it on labelled
/// real scans.
pub fn detection(config: &BirdsEyeConfig, folders: &[PathBuf], question: &Question) -> Result<Answer> {
    let Question { real, through, seeds } = question;
    ensure!(!folders.is_empty() && !seeds.is_empty(), "no folders to learn from, or no seeds");
    let grid = &config.grid;
    let translators = through.iter().map(|run| translator_for(run, config)).collect::<Result<Vec<_>>>()?;
    let real: Seen =
        labelled(real, config)?.iter().map(|scan| within(grid, scan.seen(grid, Turn::default()))).collect();
    let (images, truth): (Vec<BirdsEye>, Vec<Vehicles>) = real.into_iter().unzip();
    let vehicles: usize = truth.iter().map(|vehicles| vehicles.clear.len()).sum();
    ensure!(vehicles > 0, "{}: no vehicle within the grid", question.real.display());
    let mut table = String::from("| learned from | scans |");
    WITHIN_M.iter().try_for_each(|within| write!(table, " AP within {within} m |"))?;
    write!(table, " mean of these | AP at an overlap of {OVERLAP} |\n|---|---|{}", "---|".repeat(WITHIN_M.len() + 2))?;
    let mut last = vec![];
    for folder in folders {
        let scans = labelled(folder, config)?;
        let plain: Seen = turned(&scans, grid, config.seed);
        let ways = std::iter::once(None).chain(through.iter().zip(&translators).map(Some));
        for way in ways {
            let name = way.map_or_else(
                || folder.display().to_string(),
                |(run, _)| format!("{}, through {}", folder.display(), run.display()),
            );
            let translated = way.map(|(_, translator)| translated(&plain, translator));
            let seen = translated.as_ref().unwrap_or(&plain);
            let mut scores = vec![];
            for &seed in seeds {
                let network = fit(config, seen, seed).with_context(|| format!("{name}, seed {seed}"))?;
                last = detect(&network, &images, grid);
                let score = Score::of(&last, &truth);
                tracing::info!(name, seed, mean = score.mean(), overlap = score.overlap, "learned");
                scores.push(score);
            }
            let over_seeds =
                |of: &dyn Fn(&Score) -> f64| mean_with_interval(&scores.iter().map(of).collect::<Vec<f64>>());
            write!(table, "\n| {name} | {} |", scans.len())?;
            for i in 0..WITHIN_M.len() {
                write!(table, " {} |", over_seeds(&|score| score.within[i]))?;
            }
            write!(table, " {} | {} |", over_seeds(&Score::mean), over_seeds(&|score| score.overlap))?;
        }
    }
    writeln!(
        table,
        "\n\n{vehicles} vehicles in {} real scans; {} steps of {} scans, {}.",
        images.len(),
        config.detector.steps,
        config.detector.batch,
        seeds::said(seeds)
    )?;
    let fullest = (0..truth.len()).max_by_key(|i| truth[*i].clear.len()).unwrap_or_default();
    let picture = picture(grid, (&images[fullest], &truth[fullest]), &last[fullest])?;
    Ok(Answer { table, picture })
}

/// The scans of a folder, all with labels.
fn labelled(folder: &Path, config: &BirdsEyeConfig) -> Result<Vec<Scan>> {
    let scans = Scan::read_all(folder, config.projector()?)?;
    ensure!(scans.iter().all(|scan| scan.labelled), "{}: scans without labels", folder.display());
    let vehicles: usize = scans.iter().map(|scan| scan.vehicles.clear.len()).sum();
    ensure!(vehicles > 0, "{}: none of the labels is a vehicle's", folder.display());
    Ok(scans)
}

/// Without the vehicles whose centres are outside of the grid.
fn within(grid: &Grid, (image, vehicles): (BirdsEye, Vehicles)) -> (BirdsEye, Vehicles) {
    let inside = |list: Vec<super::Footprint>| {
        list.into_iter().filter(|vehicle| grid.cell(vehicle.center_m).is_some()).collect()
    };
    (image, Vehicles { clear: inside(vehicles.clear), unclear: vehicles.unclear })
}

/// Every scan, turned so often.
fn turned(scans: &[Scan], grid: &Grid, seed: u64) -> Seen {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let all = scans.iter().flat_map(|scan| std::iter::repeat_n(scan, TURNS));
    all.map(|scan| scan.seen(grid, Turn::random(&mut rng))).collect()
}

fn translated(seen: &Seen, translator: &Translator) -> Seen {
    let translate =
        |((image, vehicles), seed): (&(BirdsEye, Vehicles), u64)| (translator.translate(image, seed), vehicles.clone());
    seen.iter().zip(0..).map(translate).collect()
}

/// A detector that has learned from these, by the config's budget.
fn fit(config: &BirdsEyeConfig, seen: &Seen, seed: u64) -> Result<Darknet> {
    let device = config.backend.device()?.autodiff();
    device.seed(seed);
    let budget = &config.detector;
    let mut network = init(&budget.network, &device);
    let mut optimizer = AdamConfig::new().init();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for step in 0..budget.steps {
        let drawn = (0..budget.batch).map(|_| seen[rng.random_range(0..seen.len())].clone());
        let (images, vehicles): (Vec<BirdsEye>, Vec<Vehicles>) = drawn.unzip();
        let said = network.forward(tensor(&images, &device), Border::Mirror);
        let [heat, shape] = Target::new(&vehicles, &config.grid, &device).miss(&said);
        let loss = heat.clone() + shape.clone() * SHAPE_WEIGHT;
        let [heat, shape] = [heat, shape].map(|miss| miss.into_scalar::<f32>());
        ensure!(heat.is_finite() && shape.is_finite(), "step {step}: the loss is {heat} (heat), {shape} (the rest)");
        if step.is_multiple_of(LOG_EVERY) {
            tracing::info!(step, heat, shape, "detector");
        }
        let gradients = GradientsParams::from_grads(loss.backward(), &network);
        network = optimizer.step(warm_cosine(budget.learning_rate, budget.steps, step), network, gradients);
    }
    Ok(network.valid().to_device(&Device::flex()))
}

/// Average precisions.
#[derive(Clone, Copy, Debug)]
struct Score {
    within: [f64; WITHIN_M.len()],
    overlap: f64,
}

impl Score {
    fn of(found: &[Vec<Found>], truth: &[Vehicles]) -> Self {
        let scans: Vec<(Vec<Found>, &Vehicles)> = found.iter().cloned().zip(truth).collect();
        let score = |matched| average_precision(&scans, matched);
        Self { within: WITHIN_M.map(|within| score(Match::Within(within))), overlap: score(Match::Overlap(OVERLAP)) }
    }

    fn mean(&self) -> f64 {
        self.within.iter().sum::<f64>() / self.within.len() as f64
    }
}

fn picture(grid: &Grid, (image, truth): (&BirdsEye, &Vehicles), found: &[Found]) -> Result<Vec<u8>> {
    let there: Vec<_> = truth.clear.iter().map(|vehicle| vehicle.outline(grid)).collect();
    let sure = found.iter().filter(|found| found.score >= DRAWN);
    let found: Vec<_> = sure.map(|found| found.footprint.outline(grid)).collect();
    Ok(lidar::picture::from_above(&[(image, &there, "vehicles by its labels"), (image, &found, "as they were found")])?)
}
