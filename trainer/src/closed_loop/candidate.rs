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

/// Least rays, and least batches, of the sample that every effect is tried on first.
const SAMPLE: (f64, usize) = (65_536.0, 3);

/// Share of the best effect's gain on the sample from which on an effect is worth more than a glance: it could be no winner.
const WORTH_A_LOOK: f64 = 0.25;

/// The scenes that effects are found and chosen on, in two halves that exchange their parts, and what the current model makes of them.
#[derive(Debug)]
pub struct Halves<'a> {
    /// The batches of each half.
    pub batches: [Vec<&'a Batch>; 2],
    /// Some of the first half's.
    sample: Vec<&'a Batch>,
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
    /// Noise floor fitted to the sample.
    noise: Term,
    /// Hessian of its numbers there.
    hessian: DMatrix<f64>,
    /// Log-likelihoods of the sample, with that noise floor.
    sample: Score,
    /// Log-likelihoods of each half's blocks, with the noise floor of the other half.
    scores: [Vec<Score>; 2],
}

impl Baseline {
    fn new(model: &SensorModel, batches: &[Vec<&Batch>; 2], sample: &[&Batch], rays: Rays) -> Self {
        let noise = [Free::all(model.terms[0].clone())];
        let on = |batches| On { batches, channels: ActsOn::ALL, rays };
        let with_noise_of = |batches| model.with(&fit(model, &noise, &on(batches), Manner::TRIAL).terms);
        let [first, second] = batches.each_ref().map(|half| with_noise_of(half));
        let of_sample = with_noise_of(sample);
        let noise = of_sample.terms[0].clone();
        Self {
            hessian: hessian(&of_sample, &[Free::all(noise.clone())], &on(sample)),
            sample: score(&of_sample, sample, rays).into_iter().fold(Score::default(), Score::and),
            scores: [score(&second, &batches[0], rays), score(&first, &batches[1], rays)],
            noise,
        }
    }
}

/// What a first fit on the sample says of an effect that a model lacks.
#[derive(Clone, Debug)]
pub struct Glance {
    fitted: Fitted,
    /// Gain a ray on the sample that it was fitted to.
    pub gain: f64,
    /// Whether no fit to more rays could be claimed.
    pub is_hopeless: bool,
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
    /// Whether only a sample was looked at: its gain is not held out, and is never claimed.
    pub only_glanced: bool,
}

impl<'a> Halves<'a> {
    /// Scores a model on both halves.
    pub fn new(model: &SensorModel, batches: [Vec<&'a Batch>; 2]) -> Self {
        let sample = sample(&batches[0]);
        let settled = Baseline::new(model, &batches, &sample, Rays::Settled);
        let all = if model.moves_rays() { Baseline::new(model, &batches, &sample, Rays::All) } else { settled.clone() };
        Self { rays: batches.iter().map(|half| rays(half)).sum(), batches, sample, all, settled }
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

/// Rays of some batches.
fn rays(batches: &[&Batch]) -> f64 {
    batches.iter().map(|b| b.observed.range_m.shape().num_elements() as f64).sum()
}

/// Batches from all over the list, as many as a sample needs.
fn sample<'a>(batches: &[&'a Batch]) -> Vec<&'a Batch> {
    let each = rays(batches) / batches.len().max(1) as f64;
    let wanted = ((SAMPLE.0 / each.max(1.0)).ceil() as usize).clamp(SAMPLE.1, batches.len().max(SAMPLE.1));
    let wanted = wanted.min(batches.len());
    (0..wanted).map(|i| batches[i * batches.len() / wanted]).collect()
}

impl Glance {
    /// Fits an effect that the model lacks to the sample.
    pub fn at(model: &SensorModel, effect: &Arc<dyn Effect>, halves: &Halves<'_>, evidence: &Evidence) -> Self {
        let acts_on = effect.about().acts_on;
        let term = Term::new(Arc::clone(effect), evidence.rings);
        let guesses = effect.starts(evidence);
        let starts =
            if guesses.is_empty() { vec![term.clone()] } else { guesses.iter().map(|s| term.clone().at(s)).collect() };
        let before = halves.baseline(Rays::of(&term));
        let noise = Free::noise(before.noise.clone(), acts_on);
        let single = term.parameters.iter().all(|p| p.extent == Extent::One);
        let known = single
            .then(|| noise.parameters.clone())
            .map(|numbers| before.hessian.select_rows(&numbers).select_columns(&numbers));
        let on = On { batches: &halves.sample, channels: acts_on, rays: Rays::of(&term) };
        let attempt = |start: &Term, widths: &[f64]| {
            let manner = Manner { widths, known: known.as_ref(), ..Manner::TRIAL };
            fit(model, &[noise.clone(), Free::all(start.clone())], &on, manner)
        };
        // A guess is near enough: wide normals would lead away from a needle.
        let widths = if guesses.is_empty() { widths(evidence, acts_on) } else { vec![] };
        let mut tries: Vec<Fitted> = starts.iter().map(|start| attempt(start, &widths)).collect();
        let nothing = before.sample.of(acts_on);
        if !widths.is_empty() && tries.iter().all(|t| t.log_likelihood < nothing) {
            // The way through widened normals led astray.
            tries.extend(starts.iter().map(|start| attempt(start, &[])));
        }
        let fitted = tries
            .into_iter()
            .max_by(|a, b| a.log_likelihood.total_cmp(&b.log_likelihood))
            .unwrap_or_else(|| unreachable!("at least one start"));
        let gain = (fitted.log_likelihood - nothing) / rays(&halves.sample);
        let of_half = gain * rays(&halves.batches[0]);
        let least = LEAST_NATS_ON_A_HALF + 0.25 * term.fitted.len() as f64;
        Self { fitted, gain, is_hopeless: of_half.is_nan() || of_half < least }
    }

    /// Of several, those that are worth a look at all scenes.
    pub fn worth_a_look(glances: &[Self]) -> Vec<bool> {
        let most = glances.iter().map(|g| g.gain).fold(0.0, f64::max);
        glances.iter().map(|g| !g.is_hopeless && g.gain >= WORTH_A_LOOK * most).collect()
    }
}

impl Trial {
    /// Fits and scores an effect that the model lacks; one that a glance shows to be hopeless is not looked at any further.
    pub fn of(model: &SensorModel, effect: &Arc<dyn Effect>, halves: &Halves<'_>, evidence: &Evidence) -> Self {
        let glance = Glance::at(model, effect, halves, evidence);
        if glance.is_hopeless { Self::not_tried(&glance, halves) } else { Self::after(model, glance, halves) }
    }

    /// Fits and scores what was glanced at.
    pub fn after(model: &SensorModel, glance: Glance, halves: &Halves<'_>) -> Self {
        let Fitted { terms, .. } = glance.fitted;
        let acts_on = terms[1].effect.about().acts_on;
        let fitted = |terms: &[Term], half: usize| {
            let on = On { batches: &halves.batches[half], channels: acts_on, rays: Rays::of(&terms[1]) };
            let free = [Free::noise(terms[0].clone(), acts_on), Free::all(terms[1].clone())];
            fit(model, &free, &on, Manner::TRIAL)
        };
        let first = fitted(&terms, 0);
        let second = fitted(&first.terms, 1);
        Self::exchanged(first.terms[1].clone(), acts_on, model, [&first, &second], halves)
    }

    /// What was only glanced at, with the gain that the glance says.
    pub fn not_tried(glance: &Glance, halves: &Halves<'_>) -> Self {
        let blocks = halves.all.scores.iter().flatten().map(|score| Block { scene: score.scene, sum: 0.0 }).collect();
        let gain = Interval { value: glance.gain, ci95: [glance.gain; 2] };
        Self { term: glance.fitted.terms[1].clone(), gain, parts: [0.0; 3], p_value: 1.0, blocks, only_glanced: true }
    }

    /// Several effects that a model lacks, fitted together from where they are; named and sized by the first.
    pub fn of_all(model: &SensorModel, terms: &[Term], halves: &Halves<'_>) -> Self {
        let acts_on = terms.iter().map(|t| t.effect.about().acts_on).fold(ActsOn::default(), ActsOn::or);
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
        Self { term, gain, parts, p_value: p_value(&blocks), blocks, only_glanced: false }
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
