//! A translation's run, from its config to its scores.

use std::path::Path;

use anyhow::Result;
use burn::tensor::Device;
use proto::card::Score;
use serde::{Deserialize, Serialize};

use super::config::{Method, TranslationConfig};
use super::domain::{Domain, Grid};
use super::examiner::Examiner;
use super::learner::Translating;
use super::method::{Setting, approach, teacher};
use super::realness::Distance;
use super::sampler::Sampler;
use super::student::Supervised;
use super::translator::Translator;
use super::twins::Disguise;
use crate::config::DataConfig;
use crate::data;
use crate::data::Source;
use crate::generator::Generator;
use crate::loss::Weights;
use crate::network::resnet::IMAGE_CHANNELS;
use crate::network::{Measurement, UNet};
use crate::train::checkpoint::load_network;
use crate::train::run::best_of;
use crate::train::supervised::Student;
use crate::train::{Ending, Learner, Run, Trainee, teach};

/// How real the answers of a run's best network are, on test scans.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TranslationScores {
    /// Simulated test scans.
    pub simulated_scans: usize,
    /// Real test scans.
    pub real_scans: usize,
    /// Distances of the answers from real scans.
    pub model: Vec<Distance>,
    /// Distances of the simulated scans themselves.
    pub simulation: Vec<Distance>,
}

impl TranslationScores {
    /// For the model card.
    pub fn to_card(&self) -> Vec<Score> {
        let score = |(model, simulation): (&Distance, &Distance)| Score {
            metric: format!("{}, from real", model.metric),
            unit: model.unit.clone(),
            model: model.value,
            pass_through: simulation.value,
            scans: self.simulated_scans,
        };
        self.model.iter().zip(&self.simulation).map(score).collect()
    }

    /// As a table for a terminal and for the README.
    pub fn to_table(&self) -> String {
        let row = |s: Score| format!("| {} | {} | {:.4} | {:.4} |\n", s.metric, s.unit, s.pass_through, s.model);
        let rows: String = self.to_card().into_iter().map(row).collect();
        format!(
            "| distance | unit | simulation | model |\n|---|---|---|---|\n{rows}\n{} simulated scans, {} real ones of other places.\n",
            self.simulated_scans, self.real_scans
        )
    }
}

/// The best network of a run.
#[derive(Debug)]
pub enum Trained {
    /// Of a method that plays against a discriminator.
    Translator(Box<Translator>),
    /// Of the method that learns from real scans alone.
    UNet(Box<UNet>),
}

impl Generator for Trained {
    fn measure(&self, scan: burn::tensor::Tensor<4>) -> Measurement {
        match self {
            Self::Translator(network) => network.measure(scan),
            Self::UNet(network) => network.measure(scan),
        }
    }
}

/// Trains a translation; leaves what every run leaves, and `scores.json` at the end.
pub fn train(config: &TranslationConfig, run: &Run) -> Result<Option<TranslationScores>> {
    let newest = run.open(&config.to_toml()?)?;
    let grid = config.grid()?;
    let load = |list: &[DataConfig]| Domain::real(config, &run.data, list);
    let real = load(&config.real.train)?;
    let simulated = |list: &[DataConfig], real: &Domain| Domain::simulated(config, &run.data, list, real);
    let validate = simulated(&config.simulated.validate, &real)?;
    let examiner = if config.method == Method::Distil {
        Examiner::of_imitation(validate, &teacher(config)?.network)
    } else {
        let unseen = load(&config.real.validate)?;
        let twins = disguise(config, &grid, &real).map(|disguise| disguise.put_on_all(&unseen.images));
        let examiner = Examiner::new(validate, unseen).with_twins(twins.unwrap_or_default());
        if config.method == Method::Paired { examiner.of_twins_alone() } else { examiner }
    };
    let learn_from = |real: &Domain| simulated(&config.simulated.train, real);
    let mut learner = learner(config, &grid, (learn_from, real), examiner)?;
    if teach(learner.as_mut(), &config.schedule.plan(), run, newest.as_deref())? == Ending::Stopped {
        return Ok(None);
    }
    let scores = scores(config, &run.out, &run.data)?;
    lidar::formats::write_atomically(&run.out.join("scores.json"), &serde_json::to_vec_pretty(&scores)?)?;
    Ok(Some(scores))
}

/// A config's method as it begins, and the scans that it learns from; a method that learns from real scans alone loads no others.
fn learner(
    config: &TranslationConfig,
    grid: &Grid,
    (simulated, real): (impl FnOnce(&Domain) -> Result<Domain>, Domain),
    examiner: Examiner,
) -> Result<Box<dyn Learner>> {
    let (schedule, losses, rings) = (config.schedule, config.losses, grid.sensor.rings().len());
    let device = config.backend.device()?.autodiff();
    device.seed(config.seed);
    let setting = Setting {
        generator: config.training_generator()?,
        reporting: config.reporting()?,
        losses,
        image_numbers: IMAGE_CHANNELS * rings * schedule.crop_columns,
    };
    if let Some(method) = approach(config, setting, &device)? {
        let disguise = disguise(config, grid, &real);
        let sampler = Sampler {
            simulated: simulated(&real)?,
            real,
            seed: config.seed,
            batch: schedule.batch,
            crop_columns: schedule.crop_columns,
            augmentation: config.augmentation,
            disguise,
        };
        return Ok(Box::new(Translating::new(config, (method, setting), (sampler, examiner), device)));
    }
    let network = Trainee::new(config.unet.init(rings, &device), &schedule);
    let source = Source { images: real.images, drops_observed: true };
    let sampler = data::Sampler::new(vec![source], config.seed, schedule.batch, schedule.crop_columns);
    let weights = Weights { reflectance: losses.reflectance, range: losses.range };
    Ok(Box::new(Supervised { student: Student { network, sampler, device }, examiner, weights, schedule }))
}

/// How a config's real scans are made to look simulated, if it learns from that.
fn disguise(config: &TranslationConfig, grid: &Grid, real: &Domain) -> Option<Disguise> {
    config.has_twins().then(|| Disguise {
        own_vehicle: real.hidden(config, &grid.sensor),
        attenuation_per_m: config.attenuation_per_m.map(|rate_per_m| rate_per_m as f32),
        labelled: config.labeller.is_some(),
    })
}

/// The best network of a finished or unfinished run.
pub fn best_network(config: &TranslationConfig, out: &Path) -> Result<Trained> {
    let (device, path) = (Device::flex(), best_of(out));
    Ok(if config.method == Method::UNet {
        let rings = config.grid()?.sensor.rings().len();
        Trained::UNet(Box::new(load_network(&path, config.unet.init(rings, &device))?))
    } else {
        let generator = load_network(&path, config.generator.init(&device))?;
        Trained::Translator(Box::new(Translator::new(generator, config.reporting()?)))
    })
}

/// Scores a run's best network on the test scans.
pub fn scores(config: &TranslationConfig, out: &Path, data: &Path) -> Result<TranslationScores> {
    let real = Domain::real(config, data, &config.real.test)?;
    let learned = Domain::real(config, data, &config.real.train)?;
    let simulated = Domain::simulated(config, data, &config.simulated.test, &learned)?;
    let (simulated_scans, real_scans) = (simulated.images.len(), real.images.len());
    let examiner = Examiner::new(simulated, real);
    let model = examiner.of(&best_network(config, out)?);
    Ok(TranslationScores { simulated_scans, real_scans, model, simulation: examiner.of_simulation().to_vec() })
}
