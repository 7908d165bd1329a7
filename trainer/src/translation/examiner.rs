//! Scans of both domains that are not learned from, and what a generator makes of the simulated ones.

use anyhow::Result;
use burn::tensor::Device;
use lidar::RangeImage;
use serde_json::json;

use super::domain::Domain;
use super::realness::{Distance, distances};
use crate::data::sample::Sample;
use crate::evaluate::{Pair, evaluate};
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
    /// Real scans made to look simulated, where these are learned from too.
    twins: Vec<Sample>,
    /// Whether these alone decide which network is best.
    twins_alone: bool,
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
        Self { simulated, real, caption, of_simulation, twins: vec![], twins_alone: false }
    }

    /// The same examiner, who also looks at what is made of these.
    #[must_use]
    pub fn with_twins(self, twins: Vec<Sample>) -> Self {
        Self { twins, ..self }
    }

    /// The same examiner, for whom nothing but these counts.
    #[must_use]
    pub fn of_twins_alone(self) -> Self {
        Self { twins_alone: true, ..self }
    }

    /// How far the simulation itself is from real.
    pub fn of_simulation(&self) -> &[Distance] {
        &self.of_simulation
    }

    /// How far a generator's answers are from real, each scan's rays drawn once.
    pub fn of(&self, generator: &impl Generator) -> Vec<Distance> {
        distances(&answers(generator, &self.simulated.images), &self.real)
    }

    /// The same as a validation: the sum of the distances, each in units of the simulation's own; where there are twins, also of the log-loss
    /// of the keep mask, in units of the best constant's, and of the reflectance's error.
    pub fn validate(&self, generator: &impl Generator) -> Validation {
        let mut found = self.of(generator);
        let mut own: Vec<f64> = self.of_simulation.iter().map(|d| d.value).collect();
        if !self.twins.is_empty() {
            let scores = evaluate(generator, self.twins.iter().cloned(), &Device::flex());
            let log_loss = Pair { pass_through: scores.keep_log_loss_of_constant, ..scores.keep_log_loss };
            let reflectance = scores.reflectance_mae;
            for (metric, unit, pair) in [("keep log-loss", "nats/ray", log_loss), ("reflectance MAE", "", reflectance)]
            {
                found.push(Distance { metric: metric.into(), unit: unit.into(), value: pair.model });
                own.push(pair.pass_through);
            }
        }
        let counted = if self.twins_alone { self.of_simulation.len() } else { 0 };
        let total = found.iter().zip(own).skip(counted).map(|(d, own)| d.value / own.max(f64::EPSILON)).sum();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generator::PassThrough;
    use crate::translation::twins::Disguise;

    /// A wall of which every fifth ray is lost.
    fn wall(range_m: f32) -> RangeImage {
        let mut image = RangeImage::from_channels(64, vec![range_m; 16 * 64], vec![0.2; 16 * 64], vec![0; 16 * 64]);
        (0..16 * 64).step_by(5).for_each(|i| image.remove(i));
        image
    }

    #[test]
    fn twins_count_beside_the_distances_in_units_of_who_knows_nothing() {
        let domain = |range_m| Domain { images: vec![wall(range_m)], datasets: vec![] };
        let examiner = Examiner::new(domain(5.0), domain(9.0));
        let alone = examiner.validate(&PassThrough);
        let twins = Disguise::default().put_on_all(&domain(9.0).images);
        let examiner = examiner.with_twins(twins);
        let with_twins = examiner.validate(&PassThrough);
        assert_eq!((alone.curves.len(), with_twins.curves.len()), (3, 5));
        // Whoever changes no reflectance errs as much as who knows nothing, and whoever is sure that every ray returns errs more.
        assert!(with_twins.total > alone.total + 2.0, "{} {}", with_twins.total, alone.total);
        let twins_alone = examiner.of_twins_alone().validate(&PassThrough);
        assert_eq!(twins_alone.curves, with_twins.curves);
        assert!((twins_alone.total - (with_twins.total - alone.total)).abs() < 1e-9, "{}", twins_alone.total);
    }
}
