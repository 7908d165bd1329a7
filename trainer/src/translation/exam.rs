//! What translations are judged by in the end: test scans of both domains, and every metric of how real scans look.

use std::path::Path;

use anyhow::Result;
use burn::tensor::Device;
use lidar::RangeImage;
use likeness::{Draws, Score};

use super::config::TranslationConfig;
use super::domain::Domain;
use super::realness::{self as quick, Distance};
use super::twins::Disguise;
use crate::data::sample::Sample;
use crate::evaluate::evaluate;
use crate::generator::{Generator, PassThrough, answers};
use crate::realness::{Judge, Protocol, Summary};
use crate::segmentation::Segmentation;

/// Test scans, and what answers are compared with.
pub struct Exam<'s> {
    simulated: Vec<RangeImage>,
    real: Vec<RangeImage>,
    /// Real scans that are learned from, of another drive.
    learned: Vec<RangeImage>,
    /// The real scans, made to look simulated: what is asked in the same places.
    twins: Vec<Sample>,
    judge: Option<(Judge<'s>, Summary)>,
}

/// One network's scores, seed by seed, or those of what it is compared with.
#[derive(Clone, Debug, PartialEq)]
pub struct Marks {
    /// Of the simulated scans, against real ones of other places; then against the scans that are answered.
    pub elsewhere: Vec<Distance>,
    /// Of real scans that were made to look simulated, against these scans themselves; then ray by ray.
    pub twins: Vec<Distance>,
}

impl<'s> Exam<'s> {
    /// The test scans of a config. With a segmentation network every metric of [`crate::realness`] is told, at the config's grid and as the
    /// protocol defines it; without one, those of [`super::realness`].
    pub fn new(config: &TranslationConfig, data: &Path, by: Option<(&'s Segmentation, Protocol)>) -> Result<Self> {
        let grid = config.grid()?;
        let load = |list| Domain::real(config, data, list);
        let (learned, real) = (load(&config.real.train)?, load(&config.real.test)?.images);
        let simulated = Domain::simulated(config, data, &config.simulated.test, &learned)?.images;
        let own_vehicle = learned.hidden(config, &grid.sensor);
        let twins = Disguise { own_vehicle, ..Disguise::default() }.put_on_all(&real);
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
        Ok(Self { simulated, real, learned: learned.images, twins, judge: judge.transpose()? })
    }

    /// What a network makes of the simulated scans.
    pub fn answers(&self, network: &impl Generator) -> Vec<RangeImage> {
        answers(network, &self.simulated)
    }

    /// The scores of a network whose [`answers`](Self::answers) these are.
    pub fn marks(&self, network: &impl Generator, answers: &[RangeImage]) -> Result<Marks> {
        let twins = self.twins(&crate::generator::answers(network, &self.shown()), network, |score| score.model)?;
        Ok(Marks { elsewhere: self.elsewhere(answers)?, twins })
    }

    /// The scores of the scans as the simulation gives them.
    pub fn of_simulation(&self) -> Result<Marks> {
        let twins = self.twins(&self.shown(), &PassThrough, |score| score.pass_through)?;
        Ok(Marks { elsewhere: self.elsewhere(&self.simulated)?, twins })
    }

    /// What a perfect translation could be expected to score, as far as that is known: elsewhere, how far the real scans that are learned
    /// from are from those that answers are compared with; in the same places, how far these are from themselves.
    pub fn floor(&self) -> Result<Marks> {
        Ok(Marks { elsewhere: self.distances(&self.learned)?, twins: self.distances(&self.real)? })
    }

    fn elsewhere(&self, answers: &[RangeImage]) -> Result<Vec<Distance>> {
        let mut scores = self.distances(answers)?;
        if let Some((judge, _)) = &self.judge {
            scores.extend(judge.faithfulness(answers, &self.simulated)?.into_iter().map(Distance::from));
        }
        Ok(scores)
    }

    /// The real scans as they look simulated.
    fn shown(&self) -> Vec<RangeImage> {
        self.twins.iter().map(|twin| twin.simulated.clone()).collect()
    }

    /// How far answers to these are from the real scans; then the network ray by ray.
    fn twins(
        &self,
        answers: &[RangeImage],
        network: &impl Generator,
        value: fn(&proto::card::Score) -> f64,
    ) -> Result<Vec<Distance>> {
        let by_ray = evaluate(network, self.twins.iter().cloned(), &Device::flex()).to_card();
        let mut scores = self.distances(answers)?;
        scores.extend(by_ray.into_iter().map(|score| Distance {
            value: value(&score),
            metric: score.metric,
            unit: score.unit,
        }));
        Ok(scores)
    }

    /// What was compared, in a sentence.
    pub fn says(&self) -> String {
        let (simulated, real, learned) = (self.simulated.len(), self.real.len(), self.learned.len());
        format!(
            "Above, {simulated} simulated scans against {real} real ones of other places; the other drive has {learned}.\n\
             Below, these {real} themselves: holes filled, reflectance as CARLA has it, against the scans as they were."
        )
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
