//! The training loop.

use std::f64::consts::PI;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use burn::grad_clipping::GradientClippingConfig;
use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::Device;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use crate::checkpoint::{self, Progress};
use crate::config::{Schedule, TrainConfig};
use crate::data::{Sampler, Scans};
use crate::evaluate::{Scores, evaluate};
use crate::loss::Loss;
use crate::network::UNet;

/// What a run is told beside its config.
#[derive(Clone, Debug)]
pub struct Run {
    /// Where checkpoints, the log, the config and the best network go.
    pub out: PathBuf,
    /// Folder that the config's data paths are relative to.
    pub data: PathBuf,
    /// Go on from the newest checkpoint in `out`.
    pub resume: bool,
    /// Stop (with a checkpoint) after this step, as if interrupted there.
    pub stop_after: Option<usize>,
}

/// Trains a network; leaves `best.bpk`, `config.toml`, `log.jsonl` and, at the end, `scores.json` in the run's folder.
pub fn train(config: &TrainConfig, run: &Run) -> Result<Option<Scores>> {
    std::fs::create_dir_all(&run.out).with_context(|| format!("cannot make {}", run.out.display()))?;
    let newest = checkpoint::newest(&run.out)?;
    ensure!(
        run.resume || newest.is_none(),
        "{} holds a run already: go on with --resume, or choose another --out",
        run.out.display()
    );
    let toml = config.to_toml()?;
    if run.resume {
        let before = std::fs::read_to_string(run.out.join("config.toml")).context("nothing to resume here")?;
        ensure!(before == toml, "the config differs from that of the run in {}", run.out.display());
    }
    lidar::formats::write_atomically(&run.out.join("config.toml"), toml.as_bytes())?;

    let sensor = config.sensor()?;
    let load = |list: &[crate::config::DataConfig]| -> Result<Vec<Scans>> {
        list.iter().map(|data| Scans::load(&run.data, data, &sensor)).collect()
    };
    let (training, validation) = (load(&config.train)?, load(&config.validate)?);
    let device = Device::flex().autodiff();
    device.seed(config.seed);
    let mut network = config.network.init(sensor.rings().len(), &device);
    let mut optimizer = AdamConfig::new().with_grad_clipping(Some(GradientClippingConfig::Norm(1.0))).init();
    let mut progress = Progress { step: 0, best: None };
    if let (true, Some(newest)) = (run.resume, newest) {
        (network, optimizer, progress) = checkpoint::load(&newest, network, optimizer)?;
        tracing::info!(step = progress.step, "resumed");
    }
    tracing::info!(parameters = network.num_params(), "network");

    let sampler = Sampler::new(training, config.seed, config.schedule.batch, config.schedule.crop_columns);
    let mut log = std::fs::OpenOptions::new().create(true).append(true).open(run.out.join("log.jsonl"))?;
    let schedule = &config.schedule;
    let bar = progress_bar(schedule.steps, progress.step);
    let last = run.stop_after.map_or(schedule.steps, |stop| stop.min(schedule.steps));
    while progress.step < last {
        let losses;
        (network, losses) = step(network, &mut optimizer, &sampler, schedule, progress.step, &device)?;
        progress.step += 1;
        bar.set_position(progress.step as u64);
        bar.set_message(format!("keep {:.4} reflectance {:.4} range {:.5}", losses[0], losses[1], losses[2]));
        let entry = json!({"step": progress.step, "keep": losses[0], "reflectance": losses[1], "range": losses[2]});
        writeln!(log, "{entry}")?;
        if progress.step.is_multiple_of(schedule.checkpoint_every) || progress.step == last {
            validate(&network, &validation, &mut progress, run, &mut log)?;
            checkpoint::save(&run.out, &network, &optimizer, progress)?;
        }
    }
    bar.finish();
    if progress.step < schedule.steps {
        return Ok(None);
    }

    let best = best_network(config, &run.out)?;
    let test = load(&config.test)?;
    let scores = evaluate(&best, test.iter().flat_map(|s| &s.images), &Device::flex());
    lidar::formats::write_atomically(&run.out.join("scores.json"), &serde_json::to_vec_pretty(&scores)?)?;
    Ok(Some(scores))
}

/// The best network of a finished or unfinished run.
pub fn best_network(config: &TrainConfig, out: &Path) -> Result<UNet> {
    let network = config.network.init(config.sensor()?.rings().len(), &Device::flex());
    checkpoint::load_network(&out.join("best.bpk"), network)
}

/// One optimiser step; returns the losses of the keep mask, the reflectance and the range.
fn step(
    network: UNet,
    optimizer: &mut ModuleOptimizer,
    sampler: &Sampler,
    schedule: &Schedule,
    step: usize,
    device: &Device,
) -> Result<(UNet, [f32; 3])> {
    let batch = sampler.batch(step, device);
    let loss = Loss::new(network.predict(&batch.scan), &batch, schedule);
    let value = |x: &burn::tensor::Tensor<1>| x.clone().into_scalar::<f32>();
    let losses = [value(&loss.keep), value(&loss.reflectance), value(&loss.range)];
    if losses.iter().any(|l| !l.is_finite()) {
        bail!("step {step}: the loss is not finite (keep, reflectance, range: {losses:?}); the last checkpoint stands");
    }
    let gradients = GradientsParams::from_grads(loss.total.backward(), &network);
    Ok((optimizer.step(learning_rate(schedule, step), network, gradients), losses))
}

/// Linear rise over the first 2 % of the steps, then half a cosine down to 1 %.
fn learning_rate(schedule: &Schedule, step: usize) -> f64 {
    let warm_up = (schedule.steps / 50).max(1);
    let (step, steps) = (step as f64, schedule.steps as f64);
    let rise = ((step + 1.0) / warm_up as f64).min(1.0);
    schedule.learning_rate * rise * (0.01 + 0.99 * 0.5 * (1.0 + (PI * step / steps).cos()))
}

/// Scores the network on the validation scans and keeps it if it is the best so far.
fn validate(
    network: &UNet,
    validation: &[Scans],
    progress: &mut Progress,
    run: &Run,
    log: &mut impl Write,
) -> Result<()> {
    let plain = network.valid();
    let scores = evaluate(&plain, validation.iter().flat_map(|s| &s.images), &Device::flex());
    // Each score in units of what doing nothing scores, so that neither outweighs the other by its unit.
    let total = scores.keep_log_loss.model / scores.keep_log_loss_of_constant
        + scores.reflectance_mae.model / scores.reflectance_mae.pass_through;
    writeln!(log, "{}", json!({"step": progress.step, "validation": scores, "total": total}))?;
    tracing::info!(
        step = progress.step,
        log_loss = scores.keep_log_loss.model,
        auc = scores.keep_auc.model,
        decoy_auc = scores.decoy_auc,
        reflectance_mae = scores.reflectance_mae.model,
        "validation"
    );
    if progress.best.is_none_or(|(best, _)| total < best) {
        progress.best = Some((total, progress.step));
        checkpoint::save_network(&run.out.join("best.bpk"), &plain)?;
    }
    Ok(())
}

fn progress_bar(steps: usize, done: usize) -> ProgressBar {
    let bar = ProgressBar::new(steps as u64).with_position(done as u64);
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} {elapsed}<{eta} {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}
