//! The scenes that effects are found and chosen on.

use nalgebra::DMatrix;

use super::data::Batch;
use super::fit::{Fitted, Free, Manner, On, fit};
use super::model::{SensorModel, Term};
use super::score::{Scope, Score, score};
use crate::effects::ActsOn;

/// Least rays, and least batches, of the sample that every effect is tried on first.
const SAMPLE: (f64, usize) = (65_536.0, 3);

/// The scenes that effects are found and chosen on, in two halves that exchange their parts, and what the current model makes of them.
#[derive(Debug)]
pub struct Halves<'a> {
    /// The batches of each half.
    pub batches: [Vec<&'a Batch>; 2],
    /// Some of the first half's.
    pub sample: Vec<&'a Batch>,
    /// The current model on all rays.
    all: Baseline,
    /// The current model on settled rays.
    settled: Baseline,
    /// Rays of both halves.
    pub rays: f64,
}

/// What a candidate is compared with.
#[derive(Clone, Debug)]
pub struct Baseline {
    /// Noise floor fitted to the sample.
    pub noise: Term,
    /// Hessian of its numbers there.
    pub hessian: DMatrix<f64>,
    /// Log-likelihoods of the sample, with that noise floor.
    pub sample: Score,
    /// Log-likelihoods of each half's blocks, with the noise floor of the other half.
    pub scores: [Vec<Score>; 2],
}

impl Baseline {
    fn new(model: &SensorModel, batches: &[Vec<&Batch>; 2], sample: &[&Batch], scope: Scope) -> Self {
        let noise = [Free::all(model.terms[0].clone())];
        let fitted = |batches: &[&Batch], known: Option<&DMatrix<f64>>| {
            fit(model, &noise, &On { batches, channels: ActsOn::ALL, scope }, Manner { known, ..Manner::TRIAL })
        };
        let Fitted { terms, hessian, .. } = fitted(sample, None);
        // More of the same: the noise differs little, and the curvature grows with the rays.
        let [first, second] = batches.each_ref().map(|half| {
            let known = &hessian * (rays(half) / rays(sample));
            model.with(&fitted(half, Some(&known)).terms)
        });
        let of_sample = score(&model.with(&terms), sample, scope).into_iter().fold(Score::default(), Score::and);
        Self {
            noise: terms[0].clone(),
            hessian,
            sample: of_sample,
            scores: [score(&second, &batches[0], scope), score(&first, &batches[1], scope)],
        }
    }
}

impl<'a> Halves<'a> {
    /// Scores a model on both halves.
    pub fn new(model: &SensorModel, batches: [Vec<&'a Batch>; 2]) -> Self {
        let sample = sample(&batches[0]);
        let settled = Baseline::new(model, &batches, &sample, Scope::Settled);
        let all =
            if model.moves_rays() { Baseline::new(model, &batches, &sample, Scope::All) } else { settled.clone() };
        Self { rays: batches.iter().map(|half| rays(half)).sum(), batches, sample, all, settled }
    }

    /// The current model on these rays.
    pub fn baseline(&self, scope: Scope) -> &Baseline {
        match scope {
            Scope::All => &self.all,
            Scope::Settled => &self.settled,
        }
    }

    /// Every batch.
    pub fn all(&self) -> Vec<&'a Batch> {
        self.batches.concat()
    }
}

/// Rays of some batches.
pub fn rays(batches: &[&Batch]) -> f64 {
    batches.iter().map(|b| b.observed.range_m.shape().num_elements() as f64).sum()
}

/// Batches from all over the list, as many as a sample needs.
fn sample<'a>(batches: &[&'a Batch]) -> Vec<&'a Batch> {
    let share = SAMPLE.0 / rays(batches).max(1.0);
    let wanted = ((share * batches.len() as f64).ceil() as usize).max(SAMPLE.1).min(batches.len());
    (0..wanted).map(|i| batches[i * batches.len() / wanted]).collect()
}
