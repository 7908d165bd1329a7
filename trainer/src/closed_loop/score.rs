//! How likely a model makes what was measured.

use burn::tensor::Tensor;
use rayon::prelude::*;

use super::data::Batch;
use super::likelihood;
use super::model::{SensorModel, Term};
use crate::effects::ActsOn;

/// Sectors that a frame's azimuths are divided into: rays of different sectors are taken as independent.
pub const SECTORS: usize = 8;

/// Log-likelihoods of one block (a sector of a frame) in nats, summed over its rays.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// Scene of the frame.
    pub scene: usize,
    /// Of the ranges.
    pub range: f64,
    /// Of the reflectances.
    pub reflectance: f64,
    /// Of return or no return.
    pub returns: f64,
}

/// Which rays count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// All of them, as where rays are moved.
    All,
    /// Those of which the model's moved rays leave no doubt what they hit, as for everything else: see [`crate::effects::Image::settled`].
    Settled,
}

impl Scope {
    /// Those that say whether a model needs an effect.
    pub fn of(term: &Term) -> Self {
        if term.is_geometric() { Self::All } else { Self::Settled }
    }
}

impl Score {
    /// Sum of the likelihoods that something acts on.
    pub fn of(&self, acts_on: ActsOn) -> f64 {
        let part = |on: bool, x: f64| if on { x } else { 0.0 };
        part(acts_on.range, self.range)
            + part(acts_on.reflectance, self.reflectance)
            + part(acts_on.returns, self.returns)
    }

    /// Both together; the scene is no longer one.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            scene: 0,
            range: self.range + other.range,
            reflectance: self.reflectance + other.reflectance,
            returns: self.returns + other.returns,
        }
    }

    /// All of it.
    pub fn total(&self) -> f64 {
        self.of(ActsOn::ALL)
    }
}

/// Log-likelihood of everything, in nats.
pub fn total(model: &SensorModel, batches: &[&Batch], scope: Scope) -> f64 {
    score(model, batches, scope).iter().map(Score::total).sum()
}

/// Log-likelihoods under a model, block by block in the order of the batches.
pub fn score(model: &SensorModel, batches: &[&Batch], scope: Scope) -> Vec<Score> {
    let of = |batch: &&Batch| {
        let image = model.forward(batch.image.clone());
        let settled = if scope == Scope::Settled { image.settled() } else { None };
        let (surface, hit) = (settled.as_ref().map(|s| &s.surface), settled.as_ref().map(|s| &s.hit));
        let range = per_block(&counted(likelihood::range(&image, &batch.observed, 0.0), surface));
        let reflectance = per_block(&counted(likelihood::reflectance(&image, &batch.observed, 0.0), surface));
        let returns = per_block(&counted(likelihood::returns(&image, &batch.observed), hit));
        (0..range.len())
            .map(|i| Score { scene: batch.scene, range: range[i], reflectance: reflectance[i], returns: returns[i] })
            .collect::<Vec<_>>()
    };
    batches.par_iter().map(of).collect::<Vec<_>>().concat()
}

/// Log-likelihoods of the rays that count, 0 for the others.
pub(super) fn counted(nats: Tensor<3>, settled: Option<&Tensor<3>>) -> Tensor<3> {
    match settled {
        None => nats,
        Some(settled) => nats * settled.clone(),
    }
}

/// Sums over rays, sector by sector of each frame; columns in the tensor's precision, their sum in double.
pub(super) fn per_block(nats: &Tensor<3>) -> Vec<f64> {
    let [_, _, columns] = nats.dims();
    let sums: Vec<f64> = nats.clone().sum_dim(1).into_data().iter::<f64>().collect();
    let block = |frame: &[f64]| frame.chunks(columns.div_ceil(SECTORS)).map(|c| c.iter().sum()).collect::<Vec<f64>>();
    sums.chunks(columns).flat_map(block).collect()
}
