//! Scans of both domains that are not learned from, and what a generator makes of the simulated ones.

use anyhow::Result;
use burn::tensor::Device;
use lidar::RangeImage;
use serde_json::json;

use super::domain::Domain;
use super::realness::{Distance, distances};
use crate::generator::{Answer, Generator, answers};
use crate::train::Validation;

/// Held-out scans, and what answers are to look like.
#[derive(Clone, Debug)]
pub struct Examiner {
    simulated: Domain,
    /// Real scans, or what a teacher makes of the simulated ones.
    real: Vec<RangeImage>,
    /// What these are, in a picture.
    caption: &'static str,
    /// How far the simulation itself is from them.
    of_simulation: Vec<Distance>,
}

impl Examiner {
    /// An examiner with these scans.
    pub fn new(simulated: Domain, real: Domain) -> Self {
        Self::with(simulated, real.images, "real, of another place")
    }

    /// An examiner of who is to answer simulated scans as another generator does.
    pub fn of_imitation(simulated: Domain, teacher: &impl Generator) -> Self {
        let real = answers(teacher, &simulated.images);
        Self::with(simulated, real, "the teacher's")
    }

    fn with(simulated: Domain, real: Vec<RangeImage>, caption: &'static str) -> Self {
        let of_simulation = distances(&simulated.images, &real);
        Self { simulated, real, caption, of_simulation }
    }

    /// How far the simulation itself is from real.
    pub fn of_simulation(&self) -> &[Distance] {
        &self.of_simulation
    }

    /// How far a generator's answers are from real, each scan's rays drawn once.
    pub fn of(&self, generator: &impl Generator) -> Vec<Distance> {
        distances(&answers(generator, &self.simulated.images), &self.real)
    }

    /// The same as a validation: the sum of the distances, each in units of the simulation's own.
    pub fn validate(&self, generator: &impl Generator) -> Validation {
        let found = self.of(generator);
        let own = self.of_simulation.iter().map(|d| d.value.max(f64::EPSILON));
        let total = found.iter().zip(own).map(|(d, own)| d.value / own).sum();
        let curves = found.iter().map(|d| (d.metric.clone(), d.value)).collect();
        Validation { total, scores: json!(found), curves }
    }

    /// A simulated scan, the answer to it, and a scan as it should be, as PNG.
    pub fn picture(&self, generator: &impl Generator) -> Result<Vec<u8>> {
        let simulated = &self.simulated.images[0];
        let answer = Answer::new(generator, simulated, &Device::flex()).drawn(simulated, 0);
        Ok(lidar::picture::beside(&[(simulated, "simulated"), (&answer, "translated"), (&self.real[0], self.caption)])?)
    }
}
