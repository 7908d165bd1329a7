//! One effect that a model may lack: fitted on one half of the scenes, scored on the other, and the other way round.

use std::sync::Arc;

use super::data::Batch;
use nalgebra::DMatrix;

use super::fit::{Fitted, Free, Manner, On, Rays, Score, fit, hessian, score};
use super::model::{SensorModel, Term};
use super::outcome::Interval;
use super::significance::{Block, interval, p_value};
use crate::effects::{ActsOn, Effect, Evidence, Extent};

/// Least gain on the half that an effect is fitted to, beside what its numbers gain by chance: an effect with less is never claimed,
/// for there has to be more than twice this on both halves held out.
const LEAST_NATS_ON_A_HALF: f64 = 3.0;

/// The scenes that effects are found and chosen on, in two halves that exchange their parts, and what the current model makes of them.
#[derive(Debug)]
pub struct Halves<'a> {
    /// The batches of each half.
    pub batches: [Vec<&'a Batch>; 2],
    /// The current model on all rays.
    all: Baseline,
    /// The current model on settled rays.
    settled: Baseline,
    /// Rays of both halves.
    pub rays: f64,
}

/// What a candidate is compared with.
#[derive(Clone, Debug)]
struct Baseline {
    /// Noise floor fitted to the first half.
    noise: Term,
    /// Hessian of its numbers there.
    hessian: DMatrix<f64>,
    /// Log-likelihoods of the first half, with that noise floor.
    own: Score,
    /// Log-likelihoods of each half's blocks, with the noise floor of the other half.
    scores: [Vec<Score>; 2],
}

impl Baseline {
    fn new(model: &SensorModel, batches: &[Vec<&Batch>; 2], rays: Rays) -> Self {
        let noise = [Free::all(model.terms[0].clone())];
        let on = |half: usize| On { batches: &batches[half], channels: ActsOn::ALL, rays };
        let fitted = [0, 1].map(|half| model.with(&fit(model, &noise, &on(half), Manner::TRIAL).terms));
        let noise = fitted[0].terms[0].clone();
        Self {
            own: score(&fitted[0], &batches[0], rays).into_iter().fold(Score::default(), Score::and),
            hessian: hessian(&fitted[0], &[Free::all(noise.clone())], &on(0)),
            scores: [score(&fitted[1], &batches[0], rays), score(&fitted[0], &batches[1], rays)],
            noise,
        }
    }
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
        let settled = Baseline::new(model, &batches, Rays::Settled);
        let all = if model.moves_rays() { Baseline::new(model, &batches, Rays::All) } else { settled.clone() };
        let rays = batches.iter().flatten().map(|b| b.observed.range_m.shape().num_elements() as f64).sum();
        Self { batches, all, settled, rays }
    }

    fn baseline(&self, rays: Rays) -> &Baseline {
        match rays {
            Rays::All => &self.all,
            Rays::Settled => &self.settled,
        }
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
        let rays = Rays::of(&term);
        let before = halves.baseline(rays);
        let noise = Free::noise(before.noise.clone(), acts_on);
        let [first, second] = &halves.batches;
        let single = term.parameters.iter().all(|p| p.extent == Extent::One);
        let known = single
            .then(|| noise.parameters.clone())
            .map(|numbers| before.hessian.select_rows(&numbers).select_columns(&numbers));
        let on = |batches| On { batches, channels: acts_on, rays };
        let attempt = |start: &Term, widths: &[f64]| {
            let manner = Manner { widths, known: known.as_ref(), ..Manner::TRIAL };
            fit(model, &[noise.clone(), Free::all(start.clone())], &on(first), manner)
        };
        // A guess is near enough: wide normals would lead away from a needle.
        let widths = if guesses.is_empty() { widths(evidence, acts_on) } else { vec![] };
        let mut tries: Vec<Fitted> = starts.iter().map(|start| attempt(start, &widths)).collect();
        let nothing = before.own.of(acts_on);
        if !widths.is_empty() && tries.iter().all(|t| t.log_likelihood < nothing) {
            // The way through widened normals led astray.
            tries.extend(starts.iter().map(|start| attempt(start, &[])));
        }
        let best = tries
            .into_iter()
            .max_by(|a, b| a.log_likelihood.total_cmp(&b.log_likelihood))
            .unwrap_or_else(|| unreachable!("at least one start"));
        if best.log_likelihood - nothing < LEAST_NATS_ON_A_HALF + 0.25 * term.fitted.len() as f64 {
            return Self::hopeless(best.terms[1].clone(), halves);
        }
        let free = [Free::noise(best.terms[0].clone(), acts_on), Free::all(best.terms[1].clone())];
        let other = fit(model, &free, &on(second), Manner::TRIAL);
        Self::exchanged(best.terms[1].clone(), acts_on, model, [&best, &other], halves)
    }

    /// Several effects that a model lacks, fitted together from where they are; named and sized by the first.
    ///
    /// # Panics
    /// If there is none.
    pub fn of_all(model: &SensorModel, terms: &[Term], halves: &Halves<'_>) -> Self {
        let acts_on = terms.iter().map(|t| t.effect.about().acts_on).reduce(ActsOn::or).expect("an effect");
        let mut free = vec![Free::noise(model.terms[0].clone(), acts_on)];
        free.extend(terms.iter().cloned().map(Free::all));
        let fitted = |half: &Vec<&Batch>| {
            let on = On { batches: half, channels: acts_on, rays: Rays::of(&terms[0]) };
            fit(model, &free, &on, Manner::TRIAL)
        };
        let [first, second] = halves.batches.each_ref().map(fitted);
        Self::exchanged(terms[0].clone(), acts_on, model, [&first, &second], halves)
    }

    /// What each half's fit is worth on the other.
    fn exchanged(
        term: Term,
        acts_on: ActsOn,
        model: &SensorModel,
        [on_first, on_second]: [&Fitted; 2],
        halves: &Halves<'_>,
    ) -> Self {
        let [first, second] = &halves.batches;
        let rays = Rays::of(&term);
        let after =
            [score(&model.with(&on_second.terms), first, rays), score(&model.with(&on_first.terms), second, rays)];
        Self::from_scores(term, acts_on, &halves.baseline(rays).scores, halves.rays, &after)
    }

    /// An effect that is not worth a look at the other half.
    fn hopeless(term: Term, halves: &Halves<'_>) -> Self {
        let blocks = halves.all.scores.iter().flatten().map(|score| Block { scene: score.scene, sum: 0.0 }).collect();
        Self { term, gain: Interval::default(), parts: [0.0; 3], p_value: 1.0, blocks }
    }

    fn from_scores(term: Term, acts_on: ActsOn, before: &[Vec<Score>; 2], rays: f64, after: &[Vec<Score>; 2]) -> Self {
        let mut parts = [0.0; 3];
        let mut blocks = Vec::new();
        for (before, after) in before.iter().flatten().zip(after.iter().flatten()) {
            blocks.push(Block { scene: before.scene, sum: after.of(acts_on) - before.of(acts_on) });
            let of = |on: bool, gain: f64| if on { gain / rays } else { 0.0 };
            parts[0] += of(acts_on.range, after.range - before.range);
            parts[1] += of(acts_on.reflectance, after.reflectance - before.reflectance);
            parts[2] += of(acts_on.returns, after.returns - before.returns);
        }
        let gain = interval(&blocks, rays, 1);
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
        let (most, core) = (of(0.85), of(0.5) / 0.674_5);
        if most > 2.0 * core && widest.is_none_or(|(w, _)| most > w) {
            widest = Some((most, core.max(1e-3)));
        }
    };
    let returned =
        || (0..evidence.range_m.len()).filter(|i| evidence.measured_range_m[*i] > 0.0 && evidence.range_m[*i] > 0.0);
    if acts_on.range {
        consider(returned().map(|i| evidence.measured_range_m[i] - evidence.range_m[i]).collect());
    } else if acts_on.reflectance {
        consider(returned().map(|i| evidence.measured_reflectance[i] - evidence.reflectance[i]).collect());
    }
    widest.map_or_else(Vec::new, |(most, core)| vec![most.min(1.0), (most.min(1.0) * core).sqrt()])
}
