//! Learning from real scans alone: a U-Net, made to undo what makes a real scan look simulated.

use std::f64::consts::PI;
use std::path::Path;

use anyhow::Result;
use burn::grad_clipping::GradientClippingConfig;
use burn::module::Module;
use burn::optim::AdamConfig;
use burn::tensor::{Device, Tensor};
use lidar::Sensor;
use serde_json::json;

use super::checkpoint::{self, network_bytes};
use super::learner::{Learner, Losses, Validation};
use super::parts::Parts;
use super::run::{Run, best_of};
use super::teach::{Ending, Plan, teach};
use super::trainee::Trainee;
use crate::config::{DataConfig, Schedule, TrainConfig};
use crate::data::{Sampler, Scans, Source};
use crate::evaluate::{Scores, evaluate, made_simulated};
use crate::generator::Answer;
use crate::loss::{Loss, Weights};
use crate::network::UNet;

/// Trains a network; leaves what every run leaves, and `scores.json` at the end.
pub fn train(config: &TrainConfig, run: &Run) -> Result<Option<Scores>> {
    let newest = run.open(&config.to_toml()?)?;
    let sensor = config.sensor()?;
    let training = load(&config.train, &run.data, &sensor)?;
    let validation = load(&config.validate, &run.data, &sensor)?;
    let device = config.backend.device()?.autodiff();
    device.seed(config.seed);
    let network = config.network.init(sensor.rings().len(), &device);
    tracing::info!(parameters = network.num_params(), "network");
    let schedule = &config.schedule;
    let adam = AdamConfig::new().with_grad_clipping(Some(GradientClippingConfig::Norm(1.0))).init();
    let sources = training.into_iter().map(Source::from).collect();
    let sampler = Sampler::new(sources, config.seed, schedule.batch, schedule.crop_columns);
    let network = Trainee::with_optimizer(network, adam);
    let mut learner = Supervised { student: Student { network, sampler, device }, validation, schedule };
    let plan = Plan {
        steps: schedule.steps,
        checkpoint_every: schedule.checkpoint_every,
        samples_every: schedule.checkpoint_every,
        patience: 0,
    };
    if teach(&mut learner, &plan, run, newest.as_deref())? == Ending::Stopped {
        return Ok(None);
    }

    let scores = scores(config, &run.out, &run.data)?;
    lidar::formats::write_atomically(&run.out.join("scores.json"), &serde_json::to_vec_pretty(&scores)?)?;
    Ok(Some(scores))
}

/// The best network of a finished or unfinished run.
pub fn best_network(config: &TrainConfig, out: &Path) -> Result<UNet> {
    let network = config.network.init(config.sensor()?.rings().len(), &Device::flex());
    checkpoint::load_network(&best_of(out), network)
}

/// Scores a run's best network on the test scans.
pub fn scores(config: &TrainConfig, out: &Path, data: &Path) -> Result<Scores> {
    let test = load(&config.test, data, &config.sensor()?)?;
    Ok(evaluate(&best_network(config, out)?, made_simulated(test.iter().flat_map(|s| &s.images)), &Device::flex()))
}

fn load(list: &[DataConfig], root: &Path, sensor: &Sensor) -> Result<Vec<Scans>> {
    list.iter().map(|data| Scans::load(root, data, sensor)).collect()
}

/// A U-Net, and the real scans that it learns from.
#[derive(Debug)]
pub(crate) struct Student {
    pub(crate) network: Trainee<UNet>,
    pub(crate) sampler: Sampler,
    pub(crate) device: Device,
}

impl Student {
    /// One step.
    pub(crate) fn learn(&mut self, step: usize, weights: Weights, rate: f64) -> Losses {
        let batch = self.sampler.batch(step, &self.device);
        let loss = Loss::new(self.network.network.predict(&batch.scan), &batch, weights);
        let value = |x: &Tensor<1>| x.clone().into_scalar::<f32>();
        let losses =
            vec![("keep", value(&loss.keep)), ("reflectance", value(&loss.reflectance)), ("range", value(&loss.range))];
        self.network.step(rate, &mut loss.total.backward());
        losses
    }

    /// What a step is shown.
    pub(crate) fn batch(&self, step: usize) -> Vec<(&'static str, Tensor<4>)> {
        let batch = self.sampler.batch(step, &self.device);
        vec![
            ("scan", batch.scan),
            ("log_range", batch.log_range),
            ("reflectance", batch.reflectance),
            ("keep", batch.keep),
            ("keep_weight", batch.keep_weight),
        ]
    }
}

struct Supervised<'c> {
    student: Student,
    validation: Vec<Scans>,
    schedule: &'c Schedule,
}

impl Learner for Supervised<'_> {
    fn learn(&mut self, step: usize) -> Losses {
        let Schedule { reflectance_weight: reflectance, range_weight: range, .. } = *self.schedule;
        self.student.learn(step, Weights { reflectance, range }, learning_rate(self.schedule, step))
    }

    fn save(&self, parts: &mut Parts) -> Result<()> {
        self.student.network.save("network", parts)
    }

    fn load(&mut self, parts: &Parts) -> Result<()> {
        self.student.network.load("network", parts)
    }

    fn validate(&self) -> Result<Validation> {
        let scans = self.validation.iter().flat_map(|s| &s.images);
        let scores = evaluate(&self.student.network.answering(), made_simulated(scans), &Device::flex());
        // Each score in units of what doing nothing scores, so that neither outweighs the other by its unit.
        let total = scores.keep_log_loss.model / scores.keep_log_loss_of_constant
            + scores.reflectance_mae.model / scores.reflectance_mae.pass_through;
        let curves = vec![
            ("keep_log_loss".into(), scores.keep_log_loss.model),
            ("keep_auc".into(), scores.keep_auc.model),
            ("decoy_auc".into(), scores.decoy_auc),
            ("reflectance_mae".into(), scores.reflectance_mae.model),
        ];
        Ok(Validation { total, scores: json!(scores), curves })
    }

    fn weights(&self) -> Result<Vec<u8>> {
        network_bytes(&self.student.network.answering())
    }

    fn picture(&self) -> Result<Vec<u8>> {
        let network = self.student.network.answering();
        let real = &self.validation[0].images[0];
        let answer = Answer::new(&network, real, &Device::flex()).drawn(real, 0);
        Ok(lidar::picture::before_after(real, &answer)?)
    }

    fn batch(&self, step: usize) -> Vec<(&'static str, Tensor<4>)> {
        self.student.batch(step)
    }
}

/// Linear rise over the first 2 % of the steps, then half a cosine down to 1 %.
fn learning_rate(schedule: &Schedule, step: usize) -> f64 {
    let warm_up = (schedule.steps / 50).max(1);
    let (step, steps) = (step as f64, schedule.steps as f64);
    let rise = ((step + 1.0) / warm_up as f64).min(1.0);
    schedule.learning_rate * rise * (0.01 + 0.99 * 0.5 * (1.0 + (PI * step / steps).cos()))
}
