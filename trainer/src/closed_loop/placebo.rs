//! The placebo: the same scans with every residual moved to a ray drawn by lot, so that whatever it depended on, it no longer does. An
//! effect that gains as much there owes its gain to its flexibility, not to what it is a function of.

use burn::tensor::{Tensor, TensorData};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::candidate::Trial;
use super::data::Batch;
use super::likelihood::Observed;
use super::model::SensorModel;
use super::predicted::numbers;
use crate::effects::Channel;

/// Least range that a moved residual leaves, m.
const LEAST_RANGE_M: f32 = 0.01;

/// What was measured of a surface, beside what the model expects.
#[derive(Clone, Copy)]
enum Residual {
    Lost,
    Off { range_m: f32, reflectance: f32 },
}

/// The batches with the residuals of all rays that hit a surface exchanged among them; what other rays report stays where it is.
pub fn permuted(model: &SensorModel, batches: &[&Batch], seed: u64) -> Vec<Batch> {
    let mut rays: Vec<Rays> = batches.iter().map(|batch| Rays::new(model, batch)).collect();
    let mut pool: Vec<Residual> = rays.iter().flat_map(Rays::residuals).collect();
    pool.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let mut next = pool.into_iter();
    for rays in &mut rays {
        rays.take(&mut next);
    }
    let with = |(batch, rays): (&&Batch, Rays)| {
        let size = batch.observed.range_m.dims();
        let device = batch.observed.range_m.device();
        let tensor = |x: Vec<f32>| Tensor::from_data(TensorData::new(x, size), &device);
        Batch { observed: Observed::new(tensor(rays.measured_m), tensor(rays.measured)), ..(*batch).clone() }
    };
    batches.iter().zip(rays).map(with).collect()
}

/// Whether a placebo could tell: the effect depends on something, and on something that the simulation knows of a ray.
pub fn is_telling(trial: &Trial) -> bool {
    let about = trial.term.effect.about();
    !about.covariates.is_empty() && about.channel != Channel::Extra
}

/// The rays of a batch.
struct Rays {
    hit: Vec<bool>,
    expected_m: Vec<f32>,
    expected: Vec<f32>,
    measured_m: Vec<f32>,
    measured: Vec<f32>,
}

impl Rays {
    fn new(model: &SensorModel, batch: &Batch) -> Self {
        let image = model.forward(batch.image.clone());
        let list = |x: &Tensor<3>| numbers(x, batch.observed.range_m.dims());
        Self {
            hit: list(&image.surface.hit).iter().map(|hit| *hit > 0.5).collect(),
            expected_m: list(&image.report.range_m),
            expected: list(&image.report.reflectance),
            measured_m: list(&batch.observed.range_m),
            measured: list(&batch.observed.reflectance),
        }
    }

    fn hits(&self) -> impl Iterator<Item = usize> {
        (0..self.hit.len()).filter(|i| self.hit[*i])
    }

    fn residuals(&self) -> impl Iterator<Item = Residual> {
        self.hits().map(|i| {
            if self.measured_m[i] == 0.0 {
                return Residual::Lost;
            }
            let range_m = self.measured_m[i] - self.expected_m[i];
            Residual::Off { range_m, reflectance: self.measured[i] - self.expected[i] }
        })
    }

    fn take(&mut self, residuals: &mut impl Iterator<Item = Residual>) {
        for (i, residual) in self.hits().collect::<Vec<_>>().into_iter().zip(residuals) {
            (self.measured_m[i], self.measured[i]) = match residual {
                Residual::Lost => (0.0, 0.0),
                Residual::Off { range_m, reflectance } => (
                    (self.expected_m[i] + range_m).max(LEAST_RANGE_M),
                    (self.expected[i] + reflectance).clamp(0.0, 1.0),
                ),
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_loop::evidence::evidence;
    use crate::closed_loop::halves::Halves;
    use crate::closed_loop::model::Term;
    use crate::effects::library;
    use crate::effects::trial::{measured_by, sensor};

    #[test]
    fn an_effect_gains_from_its_covariate_and_not_from_the_same_residuals_elsewhere() {
        let rings = sensor().rings().len();
        let mut ideal = SensorModel::ideal(rings);
        ideal.terms[0] = ideal.terms[0].clone().at(&[0.02, 0.02, 0.05, 1e-4, 1e-4]);
        let effect = library().into_iter().find(|e| e.about().name == "range_scale").expect("the effect");
        let truth = ideal.with(&[Term::new(effect.clone(), rings).at(&[0.005])]);
        let measured = measured_by(&truth, &sensor());
        let scans: Vec<&Batch> = measured.iter().collect();
        let drawn = permuted(&ideal, &scans, 1);

        let residuals = |batches: &[&Batch]| {
            let rays: Vec<Rays> = batches.iter().map(|b| Rays::new(&ideal, b)).collect();
            let of = |r: Residual| match r {
                Residual::Lost => [f32::NAN; 2],
                Residual::Off { range_m, reflectance } => [range_m, reflectance],
            };
            rays.iter().flat_map(Rays::residuals).map(of).collect::<Vec<_>>()
        };
        let (before, after) = (residuals(&scans), residuals(&drawn.iter().collect::<Vec<_>>()));
        let sorted = |residuals: &[[f32; 2]]| {
            let mut ranges: Vec<f32> = residuals.iter().map(|r| r[0]).collect();
            ranges.sort_by(f32::total_cmp);
            ranges
        };
        let moved = before.iter().zip(&after).filter(|(a, b)| (a[0] - b[0]).abs() > 1e-3).count();
        assert!(moved > before.len() / 2, "only {moved} of {} moved", before.len());
        for (a, b) in sorted(&before).into_iter().zip(sorted(&after)) {
            assert!(a.is_nan() == b.is_nan() && (a.is_nan() || (a - b).abs() < 1e-4), "{a} became {b}");
        }

        let gain = |batches: &[&Batch]| {
            let halves = Halves::new(&ideal, [batches[..2].to_vec(), batches[2..].to_vec()]);
            Trial::of(&ideal, &effect, &halves, &evidence(&ideal, &halves.batches[0]), 0.0)
        };
        let (there, here) = (gain(&drawn.iter().collect::<Vec<_>>()), gain(&scans));
        assert!(here.gain.ci95[0] > 0.0 && !there.is_as_good_as(&here), "{:?} and {:?}", here.gain, there.gain);
        // What all residuals have in common is no covariate's.
        assert!(there.gain.value < 0.2 * here.gain.value, "{:?} and {:?}", here.gain, there.gain);
    }
}
