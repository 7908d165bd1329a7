//! What translations are judged by in the end: test scans of both domains, and every metric of how real scans look.

use std::path::Path;

use anyhow::Result;
use burn::tensor::Device;
use lidar::RangeImage;
use likeness::{Draws, Score};

use super::config::TranslationConfig;
use super::domain::Domain;
use super::realness::{self as quick, Distance};
use crate::generator::{Generator, answers};
use crate::realness::{Judge, Protocol, Summary};
use crate::segmentation::Segmentation;

/// Test scans, and what answers are compared with.
pub struct Exam<'s> {
    simulated: Vec<RangeImage>,
    real: Vec<RangeImage>,
    /// Real scans that are learned from, of another drive.
    learned: Vec<RangeImage>,
    judge: Option<(Judge<'s>, Summary)>,
}

impl<'s> Exam<'s> {
    /// The test scans of a config. With a segmentation network every metric of [`crate::realness`] is told, at the config's grid and as the
    /// protocol defines it; without one, those of [`super::realness`].
    pub fn new(config: &TranslationConfig, data: &Path, by: Option<(&'s Segmentation, Protocol)>) -> Result<Self> {
        let grid = config.grid()?;
        let load = |list| Domain::load(data, list, &grid);
        let (learned, real) = (load(&config.real.train)?, load(&config.real.test)?.images);
        let simulated = Domain::simulated(config, data, &config.simulated.test, &learned)?.images;
        let judge = by.map(|(segmentation, protocol)| -> Result<_> {
            let judge = Judge {
                sensor: grid.sensor.clone(),
                segmentation,
                device: Device::flex(),
                protocol,
                draws: Draws { count: 0, ..Draws::default() },
            };
            let real = judge.sum_up(&real)?;
            Ok((judge, real))
        });
        Ok(Self { simulated, real, learned: learned.images, judge: judge.transpose()? })
    }

    /// What a network makes of the simulated scans.
    pub fn answers(&self, network: &impl Generator) -> Vec<RangeImage> {
        answers(network, &self.simulated)
    }

    /// How far answers are from real scans; then how far from the scans that they answer, of which no [`floor`](Self::floor) is known.
    pub fn scores(&self, answers: &[RangeImage]) -> Result<Vec<Distance>> {
        let mut scores = self.distances(answers)?;
        if let Some((judge, _)) = &self.judge {
            scores.extend(judge.faithfulness(answers, &self.simulated)?.into_iter().map(Distance::from));
        }
        Ok(scores)
    }

    /// The same of the simulated scans themselves.
    pub fn of_simulation(&self) -> Result<Vec<Distance>> {
        self.scores(&self.simulated)
    }

    /// How far the real scans that are learned from are from those that answers are compared with: what a perfect translation could be
    /// expected to be.
    pub fn floor(&self) -> Result<Vec<Distance>> {
        self.distances(&self.learned)
    }

    /// What was compared, in a sentence.
    pub fn says(&self) -> String {
        let (simulated, real, learned) = (self.simulated.len(), self.real.len(), self.learned.len());
        format!("{simulated} simulated scans against {real} real ones of other places; the other drive has {learned}.")
    }

    /// The first simulated scan, what became of it under each name, and a real scan of another place, as PNG.
    pub fn picture(&self, answers: &[(&RangeImage, &str)]) -> Result<Vec<u8>> {
        let mut scans = vec![(&self.simulated[0], "simulated")];
        scans.extend(answers);
        scans.push((&self.real[0], "real, of another place"));
        Ok(lidar::picture::stacked(&scans)?)
    }

    fn distances(&self, scans: &[RangeImage]) -> Result<Vec<Distance>> {
        Ok(match &self.judge {
            None => quick::distances(scans, &self.real),
            Some((judge, real)) => {
                judge.score(&judge.sum_up(scans)?, real, judge.draws)?.into_iter().map(Distance::from).collect()
            }
        })
    }
}

impl From<Score> for Distance {
    fn from(score: Score) -> Self {
        Self { metric: score.metric.name.into(), unit: score.metric.unit.into(), value: score.value }
    }
}
