//! One effect that a model may lack: fitted on one half of the scenes, scored on the other, and the other way round.

use std::sync::Arc;

use super::data::Batch;
use super::evidence::evidence;
use super::fit::{Fitted, Free, Manner, On, fit};
use super::glance::{COULD_PASS, Glance, akin};
use super::halves::{Halves, rays};
use super::improve::Progress;
use super::model::{SensorModel, Term};
use super::outcome::Interval;
use super::score::{Scope, Score, score};
use super::significance::{Block, interval, p_value};
use crate::effects::{ActsOn, Effect, Evidence, library};

/// A candidate with its held-out gain.
#[derive(Clone, Debug)]
pub struct Trial {
    /// The effect, fitted on the first half.
    pub term: Term,
    /// The effects that it was fitted together with, likewise.
    pub like: Vec<Term>,
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

impl Trial {
    /// Fits and scores an effect that the model lacks; one of which a glance shows that it is hopeless, or gains less than `least` nats a
    /// ray even where it is fitted, is not looked at any further.
    pub fn of(
        model: &SensorModel,
        effect: &Arc<dyn Effect>,
        halves: &Halves<'_>,
        evidence: &Evidence,
        least: f64,
    ) -> Self {
        let glance = Glance::at(model, effect, halves, evidence, least);
        if glance.is_hopeless || glance.gain < least {
            Self::not_tried(&glance, halves)
        } else {
            Self::after(model, &glance, halves)
        }
    }

    /// Fits and scores what was glanced at.
    pub fn after(model: &SensorModel, glance: &Glance, halves: &Halves<'_>) -> Self {
        let acts_on = glance.fitted.terms[1].effect.about().acts_on;
        let fitted = |start: &Fitted, from: &[&Batch], to: &[&Batch]| {
            let terms = &start.terms;
            let on = On { batches: to, channels: acts_on, scope: Scope::of(&terms[1]) };
            let mut free = vec![Free::noise(terms[0].clone(), acts_on)];
            free.extend(terms[1..].iter().cloned().map(Free::all));
            let known = &start.hessian * (rays(to) / rays(from));
            fit(model, &free, &on, Manner { known: Some(&known), ..Manner::TRIAL })
        };
        let first = fitted(&glance.fitted, &halves.sample, &halves.batches[0]);
        let second = fitted(&first, &halves.batches[0], &halves.batches[1]);
        let like = first.terms[2..].to_vec();
        Self { like, ..Self::exchanged(first.terms[1].clone(), acts_on, model, [&first, &second], halves) }
    }

    /// What was only glanced at, with the gain that the glance says.
    pub fn not_tried(glance: &Glance, halves: &Halves<'_>) -> Self {
        let blocks = halves
            .baseline(Scope::All)
            .scores
            .iter()
            .flatten()
            .map(|score| Block { scene: score.scene, sum: 0.0 })
            .collect();
        let gain = Interval { value: glance.gain, ci95: [glance.gain; 2] };
        Self {
            term: glance.fitted.terms[1].clone(),
            like: vec![],
            gain,
            parts: [0.0; 3],
            p_value: 1.0,
            blocks,
            only_glanced: true,
        }
    }

    /// Effects of a model, the first of which names and sizes them, against the same model without them, which `halves` are of. They are
    /// fitted together with their like, which may take a share of what they did when they are gone.
    pub fn of_found(found: &[&Term], model: &SensorModel, halves: &Halves<'_>) -> Self {
        let acts_on = found.iter().map(|t| t.effect.about().acts_on).fold(ActsOn::default(), ActsOn::or);
        let mut free = vec![Free::noise(model.terms[0].clone(), acts_on)];
        free.extend(found.iter().map(|term| Free::all((*term).clone())));
        let like = found.iter().flat_map(|term| akin(model, term));
        for other in like.collect::<Vec<_>>() {
            if free.iter().all(|f| f.term.name() != other.term.name()) {
                free.push(other);
            }
        }
        let fitted = |half: &Vec<&Batch>| {
            let on = On { batches: half, channels: acts_on, scope: Scope::of(found[0]) };
            fit(model, &free, &on, Manner::TRIAL)
        };
        let [first, second] = halves.batches.each_ref().map(fitted);
        Self::exchanged(found[0].clone(), acts_on, model, [&first, &second], halves)
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
        let scope = Scope::of(&term);
        let after =
            [score(&model.with(&on_second.terms), first, scope), score(&model.with(&on_first.terms), second, scope)];
        Self::from_scores(term, acts_on, &halves.baseline(scope).scores, halves.rays, &after)
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
        Self { term, like: vec![], gain, parts, p_value: p_value(&blocks), blocks, only_glanced: false }
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

/// Fits every effect that the model lacks: all to a sample, those that could win to everything. `least` is the gain a ray below which a
/// term is not claimed.
pub fn try_all(
    model: &SensorModel,
    halves: &Halves<'_>,
    least: impl Fn(&Term) -> f64,
    progress: Progress<'_>,
) -> Vec<Trial> {
    let evidence = evidence(model, &halves.batches[0]);
    let lacks = library().into_iter().filter(|effect| !model.has(effect.about().name));
    let glance = |effect: Arc<dyn Effect>| {
        progress(effect.about().name);
        let least = COULD_PASS * least(&Term::new(Arc::clone(&effect), evidence.rings));
        Glance::at(model, &effect, halves, &evidence, least)
    };
    let glances: Vec<Glance> = lacks.map(glance).collect();
    let worth_a_look = Glance::worth_a_look(&glances, &least);
    let look = |(glance, worth): (Glance, bool)| {
        if worth { Trial::after(model, &glance, halves) } else { Trial::not_tried(&glance, halves) }
    };
    glances.into_iter().zip(worth_a_look).map(look).collect()
}
