//! Everything that a model has, fitted together.

use std::collections::BTreeSet;

use super::data::Batch;
use super::fit::{Free, Manner, On, fit, stderr};
use super::model::{SensorModel, Term};
use super::score::Scope;
use super::significance::few_scenes;
use crate::effects::ActsOn;

/// A model with every term fitted again, the noise floor included: where it moves rays, the others once more on those that are settled.
pub fn refitted(model: &SensorModel, batches: &[&Batch], manner: Manner<'_>) -> SensorModel {
    let model = fitted(model, &free(model, |_| true), batches, Scope::All, manner);
    if model.moves_rays() {
        fitted(&model, &free(&model, |term| !term.is_geometric()), batches, Scope::Settled, manner)
    } else {
        model
    }
}

fn fitted(model: &SensorModel, free: &[Free], batches: &[&Batch], scope: Scope, manner: Manner<'_>) -> SensorModel {
    model.with(&fit(model, free, &On { batches, channels: ActsOn::ALL, scope }, manner).terms)
}

/// Standard errors of every number of a fitted model, in the units of its parameters, with what its effects leave open.
pub fn physical_stderr(model: &SensorModel, batches: &[&Batch]) -> Vec<Vec<f64>> {
    let mut errors = by_chance(model, batches);
    for (term, errors) in model.terms.iter().zip(&mut errors) {
        let open = batches.first().map(|batch| term.effect.left_open(&term.physical(), &batch.image.rays));
        errors.iter_mut().zip(open.unwrap_or_default()).for_each(|(error, open)| *error = error.hypot(open));
    }
    errors
}

/// The part of standard errors that more scans would lessen, widened as few scenes want it.
fn by_chance(model: &SensorModel, batches: &[&Batch]) -> Vec<Vec<f64>> {
    let scenes = batches.iter().map(|b| b.scene).collect::<BTreeSet<_>>().len();
    let wider = if scenes < 3 { 1.0 } else { few_scenes(scenes as f64 - 1.0) };
    let errors = |model: &SensorModel, free: &[Free], scope| {
        let stderr = stderr(model, free, &On { batches, channels: ActsOn::ALL, scope });
        let widened = |stderr: Vec<f64>| stderr.iter().map(|e| e * wider).collect::<Vec<_>>();
        free.iter().zip(stderr).map(|(f, stderr)| f.term.physical_stderr(&widened(stderr))).collect::<Vec<_>>()
    };
    if !model.moves_rays() {
        return errors(model, &free(model, |_| true), Scope::All);
    }
    // On all rays the rest of the model has values of its own; with those of settled rays the likelihood would not be at its maximum.
    let of_all = fitted(model, &free(model, |term| !term.is_geometric()), batches, Scope::All, Manner::EXACT);
    let mut out = errors(&of_all, &free(&of_all, |_| true), Scope::All);
    let settled = errors(model, &free(model, |term| !term.is_geometric()), Scope::Settled);
    let others = model.terms.iter().zip(&mut out).filter(|(term, _)| !term.is_geometric());
    others.zip(settled).for_each(|((_, place), settled)| *place = settled);
    out
}

/// Terms of a model with all their numbers free.
fn free(model: &SensorModel, which: impl Fn(&Term) -> bool) -> Vec<Free> {
    model.terms.iter().filter(|term| which(term)).cloned().map(Free::all).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::library;
    use crate::effects::trial::{measured_by, sensor};

    #[test]
    fn errors_hold_chance_and_what_an_image_leaves_open() {
        let rings = sensor().rings().len();
        let mut ideal = SensorModel::ideal(rings);
        ideal.terms[0] = ideal.terms[0].clone().at(&[0.02, 0.02, 0.05, 1e-4, 1e-4]);
        let effect = library().into_iter().find(|e| e.about().name == "elevation_offset").expect("the effect");
        let truth = ideal.with(&[Term::new(effect, rings).at(&[0.3])]);
        let measured = measured_by(&truth, &sensor());
        let scans: Vec<&Batch> = measured.iter().collect();
        let (chance, all) = (by_chance(&truth, &scans), physical_stderr(&truth, &scans));
        assert!(chance[1][0] > 0.0 && (all[1][0] - chance[1][0].hypot(0.003)).abs() < 1e-6, "{chance:?} {all:?}");
        assert_eq!(chance[0], all[0], "the noise floor depends on no surface");
    }
}
