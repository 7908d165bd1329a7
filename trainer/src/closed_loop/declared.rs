//! The effects that a model's card declares, and the card's list of the effects that a model has.

use std::sync::Arc;

use proto::card;
use thiserror::Error;

use super::model::{SensorModel, Term};
use super::outcome::Found;
use crate::effects::covariate::Covariate;
use crate::effects::smooth_table::Axis;
use crate::effects::{Effect, NoiseFloor, SmoothTable, Target, library};

/// A card's list of effects that this program cannot take up.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum DeclaredError {
    /// The list does not begin with what every list of ours begins with.
    #[error("effects: the first is {}, expected `{expected}`: only what calibrate wrote can be taken apart and refitted", found.as_ref().map_or_else(|| "missing".to_owned(), |name| format!("`{name}`")))]
    NoNoiseFloor {
        /// The first effect's name.
        found: Option<String>,
        /// The name that it should have.
        expected: &'static str,
    },
    /// An effect that the library does not have.
    #[error("effects: the library has no effect `{name}`; it has {}", known.join(", "))]
    Unknown {
        /// Its name.
        name: String,
        /// The names of those that it has.
        known: Vec<&'static str>,
    },
    /// An effect that comes twice.
    #[error("effects: `{name}` is declared twice")]
    Twice {
        /// Its name.
        name: String,
    },
    /// A parameter that is not there as often as the effect needs it, not there at all, or not in its place.
    #[error("effects: `{effect}` has the parameters {found}, expected {expected}")]
    Parameters {
        /// The effect.
        effect: String,
        /// Names and numbers of the parameters that there are.
        found: String,
        /// Names and numbers of those that it takes.
        expected: String,
    },
    /// A value that no parameter has.
    #[error("effects: `{effect}`, {parameter} is {value}, expected a finite number")]
    NotFinite {
        /// The effect.
        effect: String,
        /// The parameter.
        parameter: String,
        /// Its value.
        value: f64,
    },
}

/// The model that a card's effects describe, for a sensor of `rings` rings.
pub fn read(effects: &[card::Effect], rings: usize) -> Result<SensorModel, DeclaredError> {
    let floor = Term::new(Arc::new(NoiseFloor), rings);
    let first = effects.first().map(|effect| effect.name.as_str());
    let (Some(first), true) = (effects.first(), first == Some(floor.name())) else {
        return Err(DeclaredError::NoNoiseFloor { found: first.map(Into::into), expected: floor.name() });
    };
    let mut model = SensorModel { terms: vec![with_values(floor, first)?] };
    for declared in &effects[1..] {
        if model.terms.iter().any(|term| term.name() == declared.name) {
            return Err(DeclaredError::Twice { name: declared.name.clone() });
        }
        model.terms.push(with_values(Term::new(effect(declared)?, rings), declared)?);
    }
    Ok(model)
}

/// The effects of a model, the noise floor first, as [`read`] takes them, with the standard errors of what was found. An effect's
/// [constants](Effect::constants) come first; a parameter with several numbers (one a ring, say) comes once for each, in their order.
pub fn write(model: &SensorModel, found: &[&Found]) -> Vec<card::Effect> {
    let effect = |term: &Term| {
        let found = found.iter().find(|found| found.term.name() == term.name());
        let stderr = |i: usize| found.and_then(|found| found.stderr.get(i).copied()).filter(|e| e.is_finite());
        let constants = term.effect.constants().into_iter().map(|(name, value)| (name, value, None));
        let fitted = parameter_names(term).into_iter().zip(term.physical()).enumerate();
        let fitted = fitted.map(|(i, (name, value))| (name.to_owned(), value, stderr(i)));
        let parameters = constants.chain(fitted).map(|(name, value, stderr)| card::Parameter { name, value, stderr });
        card::Effect { name: term.name().into(), parameters: parameters.collect() }
    };
    model.terms.iter().map(effect).collect()
}

/// The parameter's name of each number of a term.
fn parameter_names(term: &Term) -> Vec<&'static str> {
    term.layout().into_iter().flat_map(|(parameter, range)| range.map(move |_| parameter.name)).collect()
}

/// The effect of this name, with its constants.
fn effect(declared: &card::Effect) -> Result<Arc<dyn Effect>, DeclaredError> {
    let library = library();
    if let Some(effect) = library.iter().find(|effect| effect.about().name == declared.name) {
        return Ok(Arc::clone(effect));
    }
    let table = table(declared).map(|table| Arc::new(table) as Arc<dyn Effect>);
    table.ok_or_else(|| DeclaredError::Unknown {
        name: declared.name.clone(),
        known: library.iter().map(|effect| effect.about().name).collect(),
    })
}

/// The table of this name over these knots; `None` if it is none.
fn table(declared: &card::Effect) -> Option<SmoothTable> {
    let (target, covariates) = declared.name.strip_prefix("smooth_table_")?.split_once("_by_")?;
    let target = Target::ALL.into_iter().find(|t| t.name() == target)?;
    let axis = |covariate: &str| {
        let covariate = Covariate::ALL.into_iter().find(|c| c.name() == covariate)?;
        let name = covariate.knot_name();
        let knots = declared.parameters.iter().filter(|parameter| parameter.name == name);
        let knots: Vec<f32> = knots.map(|parameter| parameter.value as f32).collect();
        let ascending = knots.iter().all(|x| x.is_finite()) && knots.windows(2).all(|pair| pair[0] < pair[1]);
        (ascending && !knots.is_empty()).then_some(Axis { covariate, knots })
    };
    let axes: Vec<Axis> = covariates.split("_and_").map(axis).collect::<Option<_>>()?;
    (axes.len() <= 2).then(|| SmoothTable::on(target, axes))
}

fn with_values(term: Term, declared: &card::Effect) -> Result<Term, DeclaredError> {
    let constants = term.effect.constants();
    let expected = constants.iter().map(|(name, _)| name.as_str()).chain(parameter_names(&term));
    let expected: Vec<&str> = expected.collect();
    let found: Vec<&str> = declared.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
    if found != expected {
        let (effect, found, expected) = (declared.name.clone(), counted(&found), counted(&expected));
        return Err(DeclaredError::Parameters { effect, found, expected });
    }
    if let Some(parameter) = declared.parameters.iter().find(|parameter| !parameter.value.is_finite()) {
        let (effect, value) = (declared.name.clone(), parameter.value);
        return Err(DeclaredError::NotFinite { effect, parameter: parameter.name.clone(), value });
    }
    let fitted = &declared.parameters[constants.len()..];
    Ok(term.at(&fitted.iter().map(|parameter| parameter.value).collect::<Vec<_>>()))
}

/// `gain × 16, offset × 16`.
fn counted(names: &[&str]) -> String {
    let runs = names.chunk_by(|a, b| a == b);
    let text: Vec<String> = runs
        .map(|run| if run.len() == 1 { run[0].to_owned() } else { format!("{} × {}", run[0], run.len()) })
        .collect();
    if text.is_empty() { "none".into() } else { text.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_loop::outcome::Interval;

    fn found(term: &Term) -> Found {
        let stderr = term.fitted.iter().map(|_| 0.01).collect();
        Found { term: term.clone(), stderr, gain: Interval::default(), q_value: 0.0, ties: vec![] }
    }

    fn declared(model: &SensorModel) -> Vec<card::Effect> {
        let found: Vec<Found> = model.effects().iter().map(found).collect();
        write(model, &found.iter().collect::<Vec<_>>())
    }

    /// Every effect of the library and a table, each away from its start.
    fn everything() -> SensorModel {
        let mut model = SensorModel::ideal(3);
        let axis = |covariate, knots: &[f32]| Axis { covariate, knots: knots.to_vec() };
        let axes = vec![axis(Covariate::Reflectance, &[0.1, 0.3, 0.7]), axis(Covariate::Ring, &[0.0, 2.0])];
        let table = Arc::new(SmoothTable::on(Target::Reflectance, axes));
        for effect in library().into_iter().chain([table as Arc<dyn Effect>]) {
            let mut term = Term::new(effect, 3);
            term.fitted.iter_mut().enumerate().for_each(|(i, x)| *x = 0.3 - 0.1 * (i % 4) as f64);
            model.terms.push(term);
        }
        model
    }

    #[test]
    fn what_a_loop_found_is_declared_by_the_model_that_it_wrote() {
        let model = everything();
        let declared = declared(&model);
        let again = read(&declared, 3).expect("our own list");
        assert_eq!(again.terms.len(), model.terms.len());
        for (again, term) in again.terms.iter().zip(&model.terms) {
            assert_eq!((again.name(), again.effect.constants()), (term.name(), term.effect.constants()));
            for (a, b) in again.fitted.iter().zip(&term.fitted) {
                assert!((a - b).abs() < 1e-9, "{}: {a} for {b}", term.name());
            }
        }
        assert_eq!(declared[0].parameters[0].stderr, None);
        let fitted = |p: &&card::Parameter| !p.name.ends_with("_knot");
        assert!(declared[1..].iter().flat_map(|e| &e.parameters).filter(fitted).all(|p| p.stderr == Some(0.01)));
    }

    #[test]
    fn lists_that_cannot_be_taken_up_are_refused_by_name() {
        let good = declared(&everything());
        let refused = |edit: &dyn Fn(&mut Vec<card::Effect>)| {
            let mut effects = good.clone();
            edit(&mut effects);
            read(&effects, 3).map_or_else(|e| e.to_string(), |_| String::new())
        };
        let gain = good.iter().position(|e| e.name == "ring_gain").expect("in the library");
        assert!(refused(&|e| e.clear()).contains("the first is missing, expected `noise_floor`"));
        assert!(refused(&|e| e[0].name = "fog".into()).contains("the first is `fog`"));
        assert!(refused(&|e| e[gain].name = "gremlins".into()).contains("no effect `gremlins`; it has "));
        assert!(refused(&|e| e.push(e[gain].clone())).contains("`ring_gain` is declared twice"));
        let short = refused(&|e| drop(e[gain].parameters.remove(0)));
        assert!(short.contains("gain × 2, offset × 3, expected gain × 3, offset × 3"), "{short}");
        let unsorted = refused(&|e| e.last_mut().expect("the table").parameters.swap(0, 1));
        assert!(unsorted.contains("no effect `smooth_table_reflectance_by_reflectance_and_ring`"), "{unsorted}");
        assert!(refused(&|e| e[gain].parameters[4].value = f64::NAN).contains("offset is NaN"));
        assert_eq!(refused(&|_| {}), "");
    }
}
