//! A first fit to a few scenes, to see which effects are worth a look at all of them.

use std::sync::Arc;

use super::fit::{Fitted, Free, Manner, On, fit};
use super::halves::{Halves, rays};
use super::model::{SensorModel, Term};
use super::newton::Effort;
use super::score::Scope;
use crate::effects::{ActsOn, Effect, Evidence, Extent, library};

/// Least gain on the half that an effect is fitted to, beside what its numbers gain by chance: an effect with less is never claimed,
/// for there has to be more than twice this on both halves held out.
const LEAST_NATS_ON_A_HALF: f64 = 3.0;

/// Share of the best effect's gain on the sample from which on an effect is worth more than a glance: it could be no winner.
const WORTH_A_LOOK: f64 = 0.25;

/// Share of the least gain that can be claimed which a gain on the sample has to reach to be worth more than a glance: what gains far
/// less where it was fitted will not gain more elsewhere.
pub const COULD_PASS: f64 = 0.5;

/// What a first fit on the sample says of an effect that a model lacks.
#[derive(Clone, Debug)]
pub struct Glance {
    /// The noise floor, the effect, and those that it is fitted together with.
    pub fitted: Fitted,
    /// Gain a ray on the sample that it was fitted to.
    pub gain: f64,
    /// Whether no fit to more rays could be claimed.
    pub is_hopeless: bool,
}

impl Glance {
    /// Fits an effect that the model lacks to the sample, as far as it can be hoped to gain `least` nats a ray there.
    pub fn at(
        model: &SensorModel,
        effect: &Arc<dyn Effect>,
        halves: &Halves<'_>,
        evidence: &Evidence,
        least: f64,
    ) -> Self {
        let acts_on = effect.about().acts_on;
        let term = Term::new(Arc::clone(effect), evidence.rings);
        let guesses = effect.starts(evidence);
        let starts =
            if guesses.is_empty() { vec![term.clone()] } else { guesses.iter().map(|s| term.clone().at(s)).collect() };
        let before = halves.baseline(Scope::of(&term));
        let noise = Free::noise(before.noise.clone(), acts_on);
        let known = is_single(&term)
            .then(|| noise.parameters.clone())
            .map(|numbers| before.hessian.select_rows(&numbers).select_columns(&numbers));
        let on = On { batches: &halves.sample, channels: acts_on, scope: Scope::of(&term) };
        let akin = akin(model, &term);
        let nothing = before.sample.of(acts_on);
        let share_of_half = rays(&halves.sample) / rays(&halves.batches[0]);
        let hopeless = LEAST_NATS_ON_A_HALF + 0.25 * term.fitted.len() as f64;
        let target = -nothing - (hopeless * share_of_half).max(least * rays(&halves.sample));
        let effort = Effort { target, ..Manner::GLANCE.effort };
        let attempt = |start: &Term, widths: &[f64]| {
            let scan = !widths.is_empty();
            let manner = Manner { widths, scan, effort, known: known.as_ref() };
            let mut free = vec![noise.clone(), Free::all(start.clone())];
            free.extend(akin.iter().cloned());
            fit(model, &free, &on, manner)
        };
        // A guess is near enough: wide normals would lead away from a needle.
        let widths = if guesses.is_empty() { widths(evidence, acts_on) } else { vec![] };
        let mut tries: Vec<Fitted> = starts.iter().map(|start| attempt(start, &widths)).collect();
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
        Self { fitted, gain, is_hopeless: of_half.is_nan() || of_half < hopeless }
    }

    /// Of several, those that are worth a look at all scenes; `least` is the gain a ray below which a term is not claimed.
    pub fn worth_a_look(glances: &[Self], least: impl Fn(&Term) -> f64) -> Vec<bool> {
        let most = glances.iter().map(|g| g.gain).fold(0.0, f64::max);
        let could_win = |g: &Self| g.gain >= WORTH_A_LOOK * most;
        let could_pass = |g: &Self| g.gain >= COULD_PASS * least(&g.fitted.terms[1]);
        glances.iter().map(|g| !g.is_hopeless && could_win(g) && could_pass(g)).collect()
    }
}

/// What everything that moves rays, and that the model lacks, could gain together, nats a ray of the sample that it is fitted to.
pub fn gain_of_geometry(model: &SensorModel, halves: &Halves<'_>, evidence: &Evidence) -> f64 {
    let lacks = library().into_iter().filter(|effect| !model.has(effect.about().name));
    let terms =
        lacks.map(|effect| Term::new(effect, evidence.rings)).filter(|term| term.is_geometric() && is_single(term));
    let terms: Vec<Term> = terms.collect();
    let Some(acts_on) = terms.iter().map(|term| term.effect.about().acts_on).reduce(ActsOn::or) else { return 0.0 };
    let before = halves.baseline(Scope::All);
    let mut free = vec![Free::noise(before.noise.clone(), acts_on)];
    free.extend(akin(model, &terms[0]));
    free.extend(terms.into_iter().map(Free::all));
    let on = On { batches: &halves.sample, channels: acts_on, scope: Scope::All };
    let fitted = fit(model, &free, &on, Manner { widths: &widths(evidence, acts_on), ..Manner::GLANCE });
    (fitted.log_likelihood - before.sample.of(acts_on)) / rays(&halves.sample)
}

fn is_single(term: &Term) -> bool {
    term.parameters.iter().all(|p| p.extent == Extent::One)
}

/// Effects of the model's that may have taken a share of another's: those of its channel, tables aside.
pub fn akin(model: &SensorModel, of: &Term) -> Vec<Free> {
    let channel = of.effect.about().channel;
    let is_table = |term: &Term| term.parameters.iter().any(|p| matches!(p.extent, Extent::Knots(_)));
    let is_akin = |term: &&Term| term.effect.about().channel == channel && !is_table(term);
    model.effects().iter().filter(is_akin).cloned().map(Free::near).collect()
}

/// By how much a fit should begin with widened normals: not at all where the residual is what the noise floor says, else by what it
/// reaches and by the geometric mean of that and the noise.
fn widths(evidence: &Evidence, acts_on: ActsOn) -> Vec<f64> {
    if !acts_on.range && !acts_on.reflectance {
        return vec![];
    }
    let residual = |i: usize| {
        if acts_on.range {
            evidence.measured_range_m[i] - evidence.range_m[i]
        } else {
            evidence.measured_reflectance[i] - evidence.reflectance[i]
        }
    };
    let of_surfaces = || evidence.pixels().filter(|i| evidence.returned(*i) && evidence.range_m[*i] > 0.0);
    let of = |q| Evidence::quantile(of_surfaces().map(|i| residual(i).abs()), q).unwrap_or(0.0);
    let (most, noise) = (of(0.85).min(1.0), (of(0.5) / 0.674_5).max(1e-3));
    if most > 2.0 * noise { vec![most, (most * noise).sqrt()] } else { vec![] }
}
