//! The loop itself: try every effect that the model lacks, add the best that holds its own, refit all, drop what no longer earns its
//! place, and stop when nothing passes.

use burn::tensor::Tensor;

use super::candidate::{Halves, Trial};
use super::data::Batch;
use super::fit::{Fitted, Free, fit, score};
use super::model::SensorModel;
use super::outcome::{Candidate, Found, Interval, Outcome, Round};
use super::significance::benjamini_hochberg;
use crate::effects::{ActsOn, Evidence, library};

/// False discoveries among the claims.
const FALSE_DISCOVERIES: f64 = 0.05;

/// Least held-out gain of a claim, nats a ray.
const LEAST_GAIN: f64 = 3e-5;

/// Least held-out gain of a claim, nats in all: what chance gives a single number hardly ever.
const LEAST_NATS: f64 = 8.0;

/// Most effects that are added.
const MOST_ROUNDS: usize = 6;

/// What a round tells whoever waits.
pub type Progress<'p> = &'p dyn Fn(&str);

/// Closes the loop on the scenes of both halves. Nothing else is looked at.
pub fn improve(before: &SensorModel, batches: [Vec<&Batch>; 2], progress: Progress<'_>) -> Outcome {
    let all = batches.concat();
    let before = before.clone().with_noise_of(&evidence(before, &all));
    let fitted = refit_all(&before, &all);
    let before = before.with(&fitted.terms);
    let mut model = before.clone();
    let declared: Vec<String> = model.effects().iter().map(|t| t.name().to_owned()).collect();
    let mut rounds = Vec::new();
    let mut found: Vec<Found> = Vec::new();
    while rounds.len() < MOST_ROUNDS {
        let halves = Halves::new(&model, batches.clone());
        let mut trials = try_all(&model, &halves, progress);
        let q = benjamini_hochberg(&trials.iter().map(|t| t.p_value).collect::<Vec<_>>());
        let mut judged: Vec<(Trial, f64, bool)> = trials
            .drain(..)
            .zip(q)
            .map(|(t, q)| {
                let passed = passes(&t, q, halves.rays);
                (t, q, passed)
            })
            .collect();
        judged.sort_by(|a, b| b.0.gain.value.total_cmp(&a.0.gain.value));
        let mut round = Round {
            candidates: judged
                .iter()
                .map(|(t, q, passed)| Candidate {
                    name: t.term.name().into(),
                    gain_nats_per_pixel: t.gain,
                    q_value: *q,
                    passed: *passed,
                })
                .collect(),
            decision: String::new(),
        };
        let passed: Vec<&(Trial, f64, bool)> = judged.iter().filter(|j| j.2).collect();
        let Some((best, ..)) = passed.first() else {
            round.decision = "nothing passes: stop".into();
            rounds.push(round);
            break;
        };
        // Of those that explain the data as well as the best, the simplest; the others that are no more complicated are ties.
        let as_good: Vec<&&(Trial, f64, bool)> = passed
            .iter()
            .filter(|j| std::ptr::eq(&raw const j.0, &raw const *best) || j.0.is_as_good_as(best))
            .collect();
        let Some((winner, q, _)) = as_good.iter().min_by_key(|j| j.0.size()).map(|j| &***j) else { break };
        let ties: Vec<String> = as_good
            .iter()
            .filter(|j| j.0.term.name() != winner.term.name() && j.0.size() <= winner.size())
            .map(|j| j.0.term.name().to_owned())
            .collect();
        round.decision = format!("add {}", winner.term.name());
        progress(&round.decision);
        rounds.push(round);
        found.push(Found { term: winner.term.clone(), stderr: vec![], gain: winner.gain, q_value: *q, ties });
        model.terms.push(winner.term.clone());
        let fitted = refit_all(&model, &all);
        model = model.with(&fitted.terms);
        model = drop_idle(model, &all, &declared, &mut found);
    }
    let fitted = refit_all(&model, &all);
    model = model.with(&fitted.terms);
    let stderr = fitted.stderr();
    let with_errors = |name: &str| {
        let i = fitted.terms.iter().position(|t| t.name() == name)?;
        Some((fitted.terms[i].clone(), fitted.terms[i].physical_stderr(&stderr[i])))
    };
    for f in &mut found {
        if let Some((term, stderr)) = with_errors(f.term.name()) {
            (f.term, f.stderr) = (term, stderr);
        }
    }
    let declared = declared
        .iter()
        .filter_map(|name| with_errors(name))
        .map(|(term, stderr)| Found { term, stderr, gain: Interval::default(), q_value: 0.0, ties: vec![] })
        .collect();
    Outcome {
        before,
        after: model,
        rounds,
        effects: found,
        declared,
        unexplained: vec![],
        screening_before: super::screen::Screening::default(),
        screening_after: super::screen::Screening::default(),
        caveats: vec![],
    }
}

/// Fits every term that the model lacks.
fn try_all(model: &SensorModel, halves: &Halves<'_>, progress: Progress<'_>) -> Vec<Trial> {
    let evidence = evidence(model, &halves.batches[0]);
    library()
        .iter()
        .filter(|effect| !model.has(effect.about().name))
        .map(|effect| {
            progress(effect.about().name);
            Trial::of(model, effect, halves, &evidence)
        })
        .collect()
}

fn passes(trial: &Trial, q: f64, rays: f64) -> bool {
    q < FALSE_DISCOVERIES
        && trial.gain.value > LEAST_GAIN
        && trial.gain.value * rays > LEAST_NATS + 0.5 * trial.size() as f64
        && trial.gain.ci95[0] > 0.0
        && trial.is_plausible()
}

/// Refits every term of a model, the noise floor included.
fn refit_all(model: &SensorModel, batches: &[&Batch]) -> Fitted {
    let free: Vec<Free> = model.terms.iter().cloned().map(Free::all).collect();
    fit(model, &free, ActsOn::ALL, batches, &[])
}

/// Drops effects whose absence the others make up for; declared ones stay.
fn drop_idle(model: SensorModel, batches: &[&Batch], declared: &[String], found: &mut Vec<Found>) -> SensorModel {
    let total = |model: &SensorModel| score(model, batches).iter().map(super::fit::Score::total).sum::<f64>();
    let mut model = model;
    let mut names: Vec<String> = found.iter().map(|f| f.term.name().to_owned()).collect();
    // The newest has just been found to be needed.
    names.pop();
    for name in names {
        if declared.contains(&name) {
            continue;
        }
        let without = model.without(&name);
        let without = without.with(&refit_all(&without, batches).terms);
        let size = model.terms.iter().find(|t| t.name() == name).map_or(0, |t| t.fitted.len());
        if total(&model) - total(&without) < LEAST_NATS + size as f64 {
            found.retain(|f| f.term.name() != name);
            model = without;
        }
    }
    model
}

/// What the model predicts and what was measured, side by side.
pub fn evidence(model: &SensorModel, batches: &[&Batch]) -> Evidence {
    let mut out = Evidence::default();
    for batch in batches {
        let image = model.forward(batch.image.clone());
        let [frames, rings, columns] = batch.observed.range_m.dims();
        (out.rings, out.columns) = (rings, columns);
        out.elevation_rad = numbers(&image.rays.elevation_rad).into_iter().map(f64::from).collect();
        let full = |x: &Tensor<3>| numbers(&x.clone().expand([frames, rings, columns]));
        let hit = image.surface.hit.clone();
        out.range_m.extend(full(&(image.report.range_m.clone() * hit)));
        out.reflectance.extend(full(&image.report.reflectance));
        out.surface_reflectance.extend(full(&image.surface.reflectance));
        out.cos_incidence.extend(full(&image.surface.cos_incidence));
        out.class.extend(full(&image.surface.class));
        out.reported.extend(full(&image.reported()));
        out.measured_range_m.extend(numbers(&batch.observed.range_m));
        out.measured_reflectance.extend(numbers(&batch.observed.reflectance));
    }
    out
}

fn numbers(x: &Tensor<3>) -> Vec<f32> {
    x.clone().into_data().iter::<f32>().collect()
}
