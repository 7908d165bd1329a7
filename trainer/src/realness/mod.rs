//! How real scans look: every metric of `likeness`, with features of the segmentation network, beside what real scans score themselves.

pub mod features;
pub mod report;

use anyhow::{Result, ensure};
use burn::tensor::Device;
use lidar::{RangeImage, Sensor};
use likeness::sliced::LEAST;
use likeness::{Draws, Floor, Score, Set, cls2r};
use serde::Serialize;

use crate::segmentation::Segmentation;

/// Whose definitions of the metrics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Protocol {
    /// Ours: SI units, returns alone, azimuth wrapping round.
    #[default]
    Realbeam,
    /// Those of CLS2R's authors, as their code has them.
    Cls2r,
}

/// Judges scans of one sensor.
#[derive(Clone, Debug)]
pub struct Judge<'a> {
    /// The sensor; every scan has its size.
    pub sensor: Sensor,
    /// The network whose features scans are compared by.
    pub segmentation: &'a Segmentation,
    /// Where the network runs.
    pub device: Device,
    /// Whose definitions.
    pub protocol: Protocol,
    /// How often scans are drawn again for intervals.
    pub draws: Draws,
}

/// Scans, summed up for a [`Judge`].
#[derive(Clone, Debug)]
pub enum Summary {
    /// See [`Protocol::Realbeam`].
    Realbeam(Box<Set>),
    /// See [`Protocol::Cls2r`].
    Cls2r(cls2r::Set),
}

/// What scans are, judged against real ones of the same sensor: every metric with its interval and its floor, which is the score of one
/// half of the real scans against the other. The halves are the first and the second: neighbours in time are near-copies.
pub fn realness(outputs: &[RangeImage], real: &[RangeImage], judge: &Judge<'_>) -> Result<Vec<Score>> {
    ensure!(real.len() > 1, "{} real scan: a floor takes two", real.len());
    let (first, second) = real.split_at(real.len() / 2);
    let floor = judge.score(&judge.sum_up(first)?, &judge.sum_up(second)?, Draws { count: 0, ..judge.draws })?;
    let scores = judge.score(&judge.sum_up(outputs)?, &judge.sum_up(real)?, judge.draws)?;
    Ok(with_floor(scores, &floor))
}

/// Scores beside those of real scans on the same metrics.
pub fn with_floor(scores: Vec<Score>, floor: &[Score]) -> Vec<Score> {
    let floor_of = |score: &Score| floor.iter().find(|f| f.metric == score.metric);
    let with = |score: Score| {
        let floor = floor_of(&score).map(|f| Floor { value: f.value, scans: [f.scans, f.against] });
        Score { floor, ..score }
    };
    scores.into_iter().map(with).collect()
}

impl Judge<'_> {
    /// Sums up scans: once for a set that is compared again and again.
    pub fn sum_up(&self, images: &[RangeImage]) -> Result<Summary> {
        ensure!(!images.is_empty(), "no scan to judge");
        let size = (self.sensor.rings().len(), self.sensor.columns());
        ensure!(
            size.0.min(size.1) >= LEAST,
            "{}: {} rings and {} columns; scans are compared by patches, which take {LEAST} of both",
            self.sensor.name,
            size.0,
            size.1
        );
        for image in images {
            let found = (image.rings(), image.columns());
            ensure!(found == size, "a scan has {found:?} rings and columns, the sensor {size:?}");
        }
        Ok(match self.protocol {
            Protocol::Cls2r => Summary::Cls2r(cls2r::Set::new(images, &self.sensor)),
            Protocol::Realbeam => {
                let features = features::of_scans(self.segmentation, images, &self.sensor, &self.device)?;
                Summary::Realbeam(Box::new(Set::new(images, features, &self.sensor)))
            }
        })
    }

    /// Scores scans against real ones, without a floor.
    pub fn score(&self, outputs: &Summary, real: &Summary, draws: Draws) -> Result<Vec<Score>> {
        match (outputs, real) {
            (Summary::Realbeam(outputs), Summary::Realbeam(real)) => Ok(outputs.against(real, draws)),
            (Summary::Cls2r(outputs), Summary::Cls2r(real)) => Ok(outputs.against(real, draws)),
            _ => anyhow::bail!("scans summed up by different protocols"),
        }
    }

    /// How true outputs are to their simulations, which are in the same order and of the sensor's size.
    pub fn faithfulness(&self, outputs: &[RangeImage], simulated: &[RangeImage]) -> Result<Vec<Score>> {
        let (n, m) = (outputs.len(), simulated.len());
        ensure!(n > 0 && n == m, "{n} outputs of {m} simulated scans");
        Ok(match self.protocol {
            Protocol::Realbeam => likeness::faithful::faithfulness(outputs, simulated, &self.sensor, self.draws),
            Protocol::Cls2r => cls2r::faithfulness(outputs, simulated, &self.sensor, self.draws),
        })
    }
}
