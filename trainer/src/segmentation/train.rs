//! Training the segmentation network, and scoring it.

use std::f64::consts::PI;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::activation::log_softmax;
use burn::tensor::{Device, Tensor};
use lidar::{RangeImage, Sensor};
use proto::card::Dataset;
use sha2::{Digest, Sha256};

use super::config::SegmentationConfig;
use super::darknet::Darknet;
use super::labelled::labelled_scans;
use super::sampler::{Batch, Sampler};
use super::streets::Streets;
use super::weights::{Segmentation, SegmentationCard};
use crate::data::scans::{hex, scan_files};
use crate::network::Border;

/// Steps between two lines of the log.
const LOG_EVERY: usize = 50;

/// Trains a network on the data under `root`, and scores it on what was held out.
pub fn train(config: &SegmentationConfig, root: &Path) -> Result<Segmentation> {
    let sensor = config.sensor()?;
    let Data { learned, held_out, trained_on } = Data::load(config, root, &sensor)?;
    let sampler = Sampler::new(learned.into(), &sensor, config.seed, config.batch, config.crop_columns);
    let card =
        SegmentationCard::new(&config.summary, &config.licence, &config.notes, sensor.clone(), config.network.clone());
    let network = fit(config, &sampler)?;
    let mut trained = Segmentation { network, card: SegmentationCard { trained_on, ..card } };
    for (of, images) in &held_out {
        let score = trained.score(of, images, &sensor, &Device::flex());
        trained.card.scores.push(score);
    }
    Ok(trained)
}

/// A network that has learned from these cut-outs, by the config's budget and seed, on the CPU.
pub(super) fn fit(config: &SegmentationConfig, sampler: &Sampler) -> Result<Darknet> {
    let device = config.backend.device()?.autodiff();
    device.seed(config.seed);
    let mut network = config.network.init(&device);
    let mut optimizer = AdamConfig::new().init();
    tracing::info!(parameters = network.num_params(), "network");
    let mut sum = 0.0;
    for step in 0..config.steps {
        let rate = warm_cosine(config.learning_rate, config.steps, step);
        let loss;
        (network, loss) = learn(network, &mut optimizer, &sampler.batch(step, &device), rate);
        ensure!(loss.is_finite(), "step {step}: the loss is {loss}");
        sum += loss;
        if (step + 1).is_multiple_of(LOG_EVERY) {
            tracing::info!(step = step + 1, loss = sum / LOG_EVERY as f32, "segmentation");
            sum = 0.0;
        }
    }
    Ok(network.valid().to_device(&Device::flex()))
}

/// One optimiser step; returns the loss, in nats.
fn learn(network: Darknet, optimizer: &mut ModuleOptimizer, batch: &Batch, rate: f64) -> (Darknet, f32) {
    // A cut-out's ends are no neighbours.
    let loss = cross_entropy(network.forward(batch.scan.clone(), Border::Mirror), batch.target.clone());
    let value = loss.clone().into_scalar::<f32>();
    let gradients = GradientsParams::from_grads(loss.backward(), &network);
    (optimizer.step(rate, network, gradients), value)
}

/// Mean of −ln p(class) over labelled pixels, each weighted by its class.
fn cross_entropy(logits: Tensor<4>, target: Tensor<4>) -> Tensor<1> {
    -(log_softmax(logits, 1) * target.clone()).sum() / target.sum().clamp_min(1e-6)
}

/// The learning rate of a step: half a cosine from its highest, after a rise over the first twentieth of the steps.
pub(crate) fn warm_cosine(highest: f64, steps: usize, step: usize) -> f64 {
    let done = step as f64 / steps as f64;
    highest * (20.0 * (done + 1.0 / steps as f64)).min(1.0) * 0.5 * (1.0 + (PI * done).cos())
}

/// Labelled scans, real ones and streets.
struct Data {
    learned: [Vec<RangeImage>; 2],
    held_out: [(String, Vec<RangeImage>); 2],
    trained_on: Vec<Dataset>,
}

impl Data {
    fn load(config: &SegmentationConfig, root: &Path, sensor: &Sensor) -> Result<Self> {
        let labelled = &config.labelled;
        let folder = root.join(&labelled.path);
        let files = scan_files(&folder)?;
        let learned = files.len().saturating_sub(labelled.held_out + labelled.left_out);
        ensure!(learned > 0, "{} holds {} scans: none is left to learn from", folder.display(), files.len());
        let mut digest = Sha256::new();
        for file in &files[..learned] {
            digest.update(Sha256::digest(std::fs::read(file).with_context(|| format!("scan {}", file.display()))?));
        }
        let mut real = labelled_scans(&folder, sensor)?;
        let real_held_out = real.split_off(files.len() - labelled.held_out);
        real.truncate(learned);

        let mut streets = Streets::new(sensor, config.projected_by()?.as_ref(), config.seed);
        let count = config.streets.learned + config.streets.held_out;
        let mut made: Vec<RangeImage> = (0..count as u64).map(|k| streets.scan(k)).collect::<Result<_>>()?;
        let made_held_out = made.split_off(config.streets.learned);
        let trained_on = vec![
            Dataset {
                name: labelled.source.clone(),
                licence: labelled.licence.clone(),
                scans: learned,
                sha256: hex(&digest.finalize()),
            },
            Dataset {
                name: "streets of Realbeam's own ray caster, spoilt".into(),
                licence: "MIT OR Apache-2.0".into(),
                scans: config.streets.learned,
                sha256: String::new(),
            },
        ];
        Ok(Self {
            learned: [real, made],
            held_out: [
                (labelled.source.clone(), real_held_out),
                ("made-up streets of other seeds".into(), made_held_out),
            ],
            trained_on,
        })
    }
}
