//! One effect that a model may lack: fitted on one half of the scenes, scored on the other, and the other way round.

use std::sync::Arc;

use super::data::Batch;
use super::fit::{Fitted, Free, Score, fit, score};
use super::model::{SensorModel, Term};
use super::outcome::Interval;
use super::significance::{Block, interval, p_value};
use crate::effects::{ActsOn, Effect, Evidence};

/// The scenes that effects are found and chosen on, in two halves that exchange their parts, and what the current model makes of them.
#[derive(Debug)]
pub struct Halves<'a> {
    /// The batches of each half.
    pub batches: [Vec<&'a Batch>; 2],
    /// Log-likelihoods of each half's blocks under the current model.
    pub scores: [Vec<Score>; 2],
    /// Rays of both halves.
    pub rays: f64,
}

/// A candidate with its held-out gain.
#[derive(Clone, Debug)]
pub struct Trial {
    /// The effect, fitted on the first half.
    pub term: Term,
    /// Held-out gain of each block, over the likelihoods that the effect acts on.
    pub blocks: Vec<Block>,
    /// Gain a ray.
    pub gain: Interval,
    /// Gain a ray of each likelihood: range, reflectance, returns.
    pub parts: [f64; 3],
    /// Probability of such a gain where there is none.
    pub p_value: f64,
}

impl<'a> Halves<'a> {
    /// Scores a model on both halves.
    pub fn new(model: &SensorModel, batches: [Vec<&'a Batch>; 2]) -> Self {
        let scores = [score(model, &batches[0]), score(model, &batches[1])];
        let rays = batches.iter().flatten().map(|b| b.observed.range_m.shape().num_elements() as f64).sum();
        Self { batches, scores, rays }
    }

    /// Every batch.
    pub fn all(&self) -> Vec<&'a Batch> {
        self.batches.concat()
    }
}

impl Trial {
    /// Fits and scores an effect that the model lacks.
    pub fn of(model: &SensorModel, effect: &Arc<dyn Effect>, halves: &Halves<'_>, evidence: &Evidence) -> Self {
        let acts_on = effect.about().acts_on;
        let term = Term::new(Arc::clone(effect), evidence.rings);
        let guesses = effect.starts(evidence);
        let starts =
            if guesses.is_empty() { vec![term.clone()] } else { guesses.iter().map(|s| term.clone().at(s)).collect() };
        let noise = Free::noise(model.terms[0].clone(), acts_on);
        let [first, second] = &halves.batches;
        let attempt = |start: &Term, widths: &[f64]| {
            fit(model, &[noise.clone(), Free::all(start.clone())], acts_on, first, widths)
        };
        // A guess is near enough: wide normals would lead away from a needle.
        let widths = if guesses.is_empty() { widths(evidence, acts_on) } else { vec![] };
        let mut tries: Vec<Fitted> = starts.iter().map(|start| attempt(start, &widths)).collect();
        let nothing: f64 = halves.scores[0].iter().map(|s| s.of(acts_on)).sum();
        if !widths.is_empty() && tries.iter().all(|t| t.log_likelihood < nothing) {
            // The way through widened normals led astray.
            tries.extend(starts.iter().map(|start| attempt(start, &[])));
        }
        let best = tries
            .into_iter()
            .max_by(|a, b| a.log_likelihood.total_cmp(&b.log_likelihood))
            .unwrap_or_else(|| unreachable!("at least one start"));
        let free = [Free::noise(best.terms[0].clone(), acts_on), Free::all(best.terms[1].clone())];
        let other = fit(model, &free, acts_on, second, &[]);

        let after = [score(&model.with(&other.terms), first), score(&model.with(&best.terms), second)];
        Self::from_scores(best.terms[1].clone(), acts_on, halves, &after)
    }

    fn from_scores(term: Term, acts_on: ActsOn, halves: &Halves<'_>, after: &[Vec<Score>; 2]) -> Self {
        let mut parts = [0.0; 3];
        let mut blocks = Vec::new();
        for (before, after) in halves.scores.iter().flatten().zip(after.iter().flatten()) {
            blocks.push(Block { scene: before.scene, sum: after.of(acts_on) - before.of(acts_on) });
            let of = |on: bool, gain: f64| if on { gain / halves.rays } else { 0.0 };
            parts[0] += of(acts_on.range, after.range - before.range);
            parts[1] += of(acts_on.reflectance, after.reflectance - before.reflectance);
            parts[2] += of(acts_on.returns, after.returns - before.returns);
        }
        let gain = interval(&blocks, halves.rays, 1);
        Self { term, gain, parts, p_value: p_value(&blocks), blocks }
    }

    /// Whether every parameter is one that a sensor could have.
    pub fn is_plausible(&self) -> bool {
        let physical = self.term.physical();
        self.term.layout().into_iter().all(|(parameter, range)| {
            physical[range].iter().all(|x| *x >= parameter.prior.0 && *x <= parameter.prior.1)
        })
    }

    /// Whether it gains no more than chance above this one; both over the same blocks.
    pub fn is_as_good_as(&self, best: &Self) -> bool {
        let difference: Vec<Block> = best
            .blocks
            .iter()
            .zip(&self.blocks)
            .map(|(best, this)| Block { scene: best.scene, sum: best.sum - this.sum })
            .collect();
        p_value(&difference) > 0.05
    }

    /// The effect's name.
    pub fn name(&self) -> &'static str {
        self.term.name()
    }

    /// How many numbers it takes.
    pub fn size(&self) -> usize {
        self.term.fitted.len()
    }
}

/// By how much a fit should begin with widened normals: not at all where the residual is what the noise floor says, else by what it
/// reaches and by the geometric mean of that and the noise.
fn widths(evidence: &Evidence, acts_on: ActsOn) -> Vec<f64> {
    let mut widest: Option<(f64, f64)> = None;
    let mut consider = |residuals: Vec<f32>| {
        let of = |q| Evidence::quantile(residuals.iter().map(|r| r.abs()), q).unwrap_or(0.0);
        let (most, core) = (of(0.95), of(0.5) / 0.674_5);
        if most > 2.6 * core && widest.is_none_or(|(w, _)| most > w) {
            widest = Some((most, core.max(1e-3)));
        }
    };
    let returned =
        || (0..evidence.range_m.len()).filter(|i| evidence.measured_range_m[*i] > 0.0 && evidence.range_m[*i] > 0.0);
    if acts_on.range {
        consider(returned().map(|i| evidence.measured_range_m[i] - evidence.range_m[i]).collect());
    }
    if acts_on.reflectance {
        consider(returned().map(|i| evidence.measured_reflectance[i] - evidence.reflectance[i]).collect());
    }
    widest.map_or_else(Vec::new, |(most, core)| vec![most.min(1.0), (most.min(1.0) * core).sqrt()])
}
