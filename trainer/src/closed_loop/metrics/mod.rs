//! How far a model is from what was measured on scenes that it has never seen, before and after the loop, and how far any would be.
//!
//! Every model is judged on the same rays. A range counts where both models know one certain surface: moved rays that a second surface or
//! an unknown plane makes uncertain are counted apart (an image cannot know what lies behind an edge), as are returns that neither model
//! explains.

mod chamfer;
mod kd_tree;
mod tally;

use burn::tensor::{Tensor, TensorData};
use lidar::{RangeImage, ray_drop};
use rayon::prelude::*;
use serde::Serialize;

use self::tally::{Frame, Guess, Tally};
use super::data::Batch;
use super::model::SensorModel;
use super::outcome::Interval;
use super::predicted::{Predicted, numbers};
use super::resample::{Bootstrap, weighted};
use crate::effects::{Drawn, Image, NOISE_CHANNELS};

/// Names and units of the metrics, in the order of a report. All are better when nearer to 0.
pub const METRICS: [(&str, &str); 8] = [
    ("range_mae_m", "m"),
    ("range_rmse_m", "m"),
    ("range_bias_m", "m"),
    ("keep_log_loss", "nats a ray"),
    ("keep_brier", ""),
    ("reflectance_mae", ""),
    ("extra_returns_per_scan", "returns"),
    ("chamfer_m", "m"),
];

/// A metric that is worse by less than this share is not called worse.
const LEAST_CHANGE: f64 = 0.01;

/// The metrics of a model before and after.
#[derive(Clone, Debug, Serialize)]
pub struct Confirmation {
    /// In the order of [`METRICS`].
    pub metrics: Vec<Metric>,
    /// Names of those that got worse, beyond chance.
    pub got_worse: Vec<&'static str>,
    /// Rays whose surface is uncertain to either model.
    pub edge_rays: EdgeRays,
    /// Returns a scan that neither model explains by a surface.
    pub unexplained_returns_per_scan: f64,
}

/// One metric.
#[derive(Clone, Debug, Serialize)]
pub struct Metric {
    /// Its name.
    pub name: &'static str,
    /// Of the model before; what the model says is the median range and reflectance, and the probability of a return.
    pub before: Interval,
    /// Of the model after.
    pub after: Interval,
    /// What the model after could not be better than if it were the truth: its own noise.
    pub ceiling: f64,
    /// Of one scan drawn from the model after, with its noise and its lost rays; none where that makes no sense.
    pub drawn: Option<Interval>,
}

/// What is counted apart.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct EdgeRays {
    /// Share of all rays.
    pub share: f64,
    /// Mean distance of their returns from the model before, m.
    pub before_mae_m: f64,
    /// From the model after, m.
    pub after_mae_m: f64,
}

impl Confirmation {
    /// A metric by its name.
    pub fn of(&self, name: &str) -> Option<&Metric> {
        self.metrics.iter().find(|m| m.name == name)
    }
}

/// Judges two models on batches that neither was fitted on.
///
/// # Panics
/// If there is no batch.
pub fn confirm(before: &SensorModel, after: &SensorModel, batches: &[&Batch], seed: u64) -> Confirmation {
    let judged: Vec<Judged> = batches.par_iter().flat_map(|batch| judge(before, after, batch, seed, None)).collect();
    let sums = Sums::new(&judged, seed);
    let metrics = (0..METRICS.len())
        .map(|i| Metric {
            name: METRICS[i].0,
            before: sums.interval(i, |j| &j.before),
            after: sums.interval(i, |j| &j.after),
            ceiling: sums.interval(i, |j| &j.ceiling).value,
            drawn: (METRICS[i].0 != "keep_log_loss").then(|| sums.interval(i, |j| &j.drawn)),
        })
        .collect();
    let got_worse = (0..METRICS.len()).filter(|i| sums.got_worse(*i)).map(|i| METRICS[i].0).collect();
    let mean = |of: &dyn Fn(&Judged) -> (f64, f64)| {
        let (above, below) = judged.iter().map(of).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        above / below.max(1e-9)
    };
    Confirmation {
        metrics,
        got_worse,
        edge_rays: EdgeRays {
            share: mean(&|j| (j.edges, j.rays)),
            before_mae_m: mean(&|j| j.before.edge),
            after_mae_m: mean(&|j| j.after.edge),
        },
        unexplained_returns_per_scan: mean(&|j| (j.unexplained, 1.0)),
    }
}

/// The same metrics of scans that somebody made of the batches' frames, one a frame in their order, such as the files that a served model
/// wrote; on the same rays as [`confirm`]'s. In the order of [`METRICS`]; a scan has no probabilities, so no logarithmic loss.
///
/// # Panics
/// If there is no batch, or not a scan a frame.
pub fn of_scans(
    scans: &[RangeImage],
    [before, after]: [&SensorModel; 2],
    batches: &[&Batch],
    seed: u64,
) -> Vec<(&'static str, Interval)> {
    let mut next = scans;
    let with: Vec<(&Batch, &[RangeImage])> = batches
        .iter()
        .map(|batch| {
            let (of, rest) = next.split_at(batch.frames.len());
            next = rest;
            (*batch, of)
        })
        .collect();
    let judged: Vec<Judged> =
        with.par_iter().flat_map(|(batch, scans)| judge(before, after, batch, seed, Some(*scans))).collect();
    let sums = Sums::new(&judged, seed);
    let named = METRICS.iter().enumerate().filter(|(_, (name, _))| *name != "keep_log_loss");
    named.map(|(i, (name, _))| (*name, sums.interval(i, |j| &j.drawn))).collect()
}

/// One frame's tallies.
#[derive(Clone, Debug)]
struct Judged {
    scene: usize,
    before: Tally,
    after: Tally,
    ceiling: Tally,
    drawn: Tally,
    rays: f64,
    edges: f64,
    unexplained: f64,
}

/// Judges each frame of a batch; `scans` stands for a drawn scan.
fn judge(
    before: &SensorModel,
    after: &SensorModel,
    batch: &Batch,
    seed: u64,
    scans: Option<&[RangeImage]>,
) -> Vec<Judged> {
    let dims = batch.observed.range_m.dims();
    let image = after.forward(batch.image.clone());
    let predicted = [Predicted::new(before, batch), Predicted::of(&image, batch)];
    let directions: [Vec<f32>; 3] =
        image.rays.directions(&crate::effects::Bend::default()).map(|x| numbers(&x, [1, dims[1], dims[2]]));
    let scans = scans.map_or_else(|| draw(image, batch, seed), <[RangeImage]>::to_vec);
    let one = |k: usize| {
        let frame = Frame::new([&predicted[0], &predicted[1]], k, &directions);
        let scan = &scans[k];
        Judged {
            scene: batch.scene,
            before: frame.tally(&Guess::of_model(&predicted[0], k)),
            after: frame.tally(&Guess::of_model(&predicted[1], k)),
            ceiling: frame.ceiling(scan),
            drawn: frame.tally(&Guess::of_scan(scan, &frame)),
            rays: predicted[1].rays() as f64,
            edges: frame.edges() as f64,
            unexplained: frame.unexplained() as f64,
        }
    };
    (0..batch.frames.len()).map(one).collect()
}

/// One scan of each frame, drawn with noise and lost rays, a key stream a frame.
fn draw(image: Image, batch: &Batch, seed: u64) -> Vec<RangeImage> {
    let dims @ [_, rings, columns] = batch.observed.range_m.dims();
    let device = image.device();
    let uniform = |channel: u32| -> Vec<f32> {
        let of = |frame: &usize| {
            let mut numbers = vec![0.0; rings * columns];
            ray_drop::uniform(seed.wrapping_add(*frame as u64), channel, columns, &mut numbers);
            numbers
        };
        batch.frames.iter().flat_map(of).collect()
    };
    let noise: [Tensor<3>; NOISE_CHANNELS] =
        std::array::from_fn(|i| Tensor::from_data(TensorData::new(uniform(i as u32 + 1), dims), &device));
    let Drawn { range_m, reflectance, keep } = image.draw(noise);
    let (range_m, reflectance, keep) = (numbers(&range_m, dims), numbers(&reflectance, dims), numbers(&keep, dims));
    let reported = uniform(0).into_iter().zip(keep).map(|(u, keep)| u < keep);
    let range_m: Vec<f32> = range_m.into_iter().zip(reported).map(|(r, yes)| if yes { r } else { 0.0 }).collect();
    let frames = range_m.chunks(rings * columns).zip(reflectance.chunks(rings * columns));
    frames.map(|(r, i)| RangeImage::from_channels(columns, r.to_vec(), i.to_vec(), vec![0; r.len()])).collect()
}

/// Tallies summed by block: scenes, or frames where there are fewer than three scenes.
struct Sums<'a> {
    judged: &'a [Judged],
    block_of: Vec<usize>,
    blocks: usize,
    bootstrap: Bootstrap,
}

impl<'a> Sums<'a> {
    fn new(judged: &'a [Judged], seed: u64) -> Self {
        let mut scenes: Vec<usize> = judged.iter().map(|j| j.scene).collect();
        scenes.sort_unstable();
        scenes.dedup();
        let by_scene = scenes.len() >= 3;
        let block = |(i, j): (usize, &Judged)| if by_scene { scenes.partition_point(|s| *s < j.scene) } else { i };
        let block_of = judged.iter().enumerate().map(block).collect();
        let blocks = if by_scene { scenes.len() } else { judged.len() };
        Self { judged, block_of, blocks, bootstrap: Bootstrap::new(blocks, seed) }
    }

    fn blocks(&self, metric: usize, of: impl Fn(&Judged) -> &Tally) -> [Vec<f64>; 2] {
        let mut sums = [vec![0.0; self.blocks], vec![0.0; self.blocks]];
        for (judged, block) in self.judged.iter().zip(&self.block_of) {
            let (above, below) = of(judged).metrics[metric];
            sums[0][*block] += above;
            sums[1][*block] += below;
        }
        sums
    }

    fn interval(&self, metric: usize, of: impl Fn(&Judged) -> &Tally) -> Interval {
        let sums = self.blocks(metric, of);
        self.bootstrap.interval(|times| finish(metric, &sums, times))
    }

    /// Whether a metric is farther from 0 after than before, on the same draws.
    fn got_worse(&self, metric: usize) -> bool {
        let (before, after) = (self.blocks(metric, |j| &j.before), self.blocks(metric, |j| &j.after));
        let worse = |times: &[f64]| finish(metric, &after, times).abs() - finish(metric, &before, times).abs();
        let found = self.bootstrap.interval(worse);
        let was = finish(metric, &before, &vec![1.0; self.blocks]).abs();
        found.ci95[0] > 0.0 && found.value > LEAST_CHANGE * was
    }
}

fn finish(metric: usize, [above, below]: &[Vec<f64>; 2], times: &[f64]) -> f64 {
    let mean = weighted(times, above) / weighted(times, below);
    if METRICS[metric].0 == "range_rmse_m" { mean.sqrt() } else { mean }
}

#[cfg(test)]
mod tests;
