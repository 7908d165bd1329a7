//! Scans of both domains that are not learned from, and what a generator makes of the simulated ones.

use anyhow::Result;
use burn::tensor::Device;
use serde_json::json;

use super::domain::Domain;
use super::realness::{Distance, distances};
use crate::generator::{Answer, Generator, answers};
use crate::train::Validation;

/// Held-out scans.
#[derive(Clone, Debug)]
pub struct Examiner {
    simulated: Domain,
    real: Domain,
    /// How far the simulation itself is from real.
    of_simulation: Vec<Distance>,
}

impl Examiner {
    /// An examiner with these scans.
    pub fn new(simulated: Domain, real: Domain) -> Self {
        let of_simulation = distances(&simulated.images, &real.images);
        Self { simulated, real, of_simulation }
    }

    /// How far the simulation itself is from real.
    pub fn of_simulation(&self) -> &[Distance] {
        &self.of_simulation
    }

    /// How far a generator's answers are from real, each scan's rays drawn once.
    pub fn of(&self, generator: &impl Generator) -> Vec<Distance> {
        distances(&answers(generator, &self.simulated.images), &self.real.images)
    }

    /// The same as a validation: the sum of the distances, each in units of the simulation's own.
    pub fn validate(&self, generator: &impl Generator) -> Validation {
        let found = self.of(generator);
        let own = self.of_simulation.iter().map(|d| d.value.max(f64::EPSILON));
        let total = found.iter().zip(own).map(|(d, own)| d.value / own).sum();
        let curves = found.iter().map(|d| (d.metric.clone(), d.value)).collect();
        Validation { total, scores: json!(found), curves }
    }

    /// A simulated scan, the answer to it, and a real scan of another place, as PNG.
    pub fn picture(&self, generator: &impl Generator) -> Result<Vec<u8>> {
        let simulated = &self.simulated.images[0];
        let answer = Answer::new(generator, simulated, &Device::flex()).drawn(simulated, 0);
        Ok(lidar::picture::beside(&[
            (simulated, "simulated"),
            (&answer, "translated"),
            (&self.real.images[0], "real, of another place"),
        ])?)
    }
}
