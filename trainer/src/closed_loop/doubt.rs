//! What an image does not know of the world: what else seems to be missing beside an effect that depends on it may be no more than that.
//! The shares were chosen on hidden sets; they are part of the method.

use super::black_box::Table;
use super::outcome::Found;
use crate::effects::{ActsOn, Channel};

/// Share of the gain of an effect that moves rays below which whatever else seems to be missing may be what an image does not know of the
/// surfaces that moved rays hit.
const OF_SURFACES: f64 = 0.003;

/// The same of an effect over the angle of incidence, which an image shows only roughly.
const OF_INCIDENCE: f64 = 0.01;

/// The same of a table, whose knots follow what it stands for only so closely.
const OF_TABLES: f64 = 0.02;

/// What something that acts on these likelihoods could gain, in nats a ray, because the image knows less than an effect needs.
pub fn beside(found: &Found, acts_on: ActsOn) -> f64 {
    let about = found.term.effect.about();
    let share = if found.term.is_geometric() {
        OF_SURFACES
    } else if about.covariates.contains(&"incidence") && about.acts_on.overlaps(acts_on) {
        OF_INCIDENCE
    } else {
        0.0
    };
    share * found.gain.value
}

/// The same beside a table.
pub fn beside_table(table: &Table, acts_on: ActsOn) -> f64 {
    let overlaps = table.trial.term.effect.about().acts_on.overlaps(acts_on);
    if overlaps { OF_TABLES * table.trial.gain.value } else { 0.0 }
}

/// The likelihoods that a channel's residual shows in.
pub fn likelihoods(channel: Channel) -> ActsOn {
    match channel {
        Channel::Geometry | Channel::Range | Channel::RangeVariance => ActsOn::RANGE,
        Channel::Reflectance => ActsOn::REFLECTANCE,
        Channel::Missing | Channel::Extra => ActsOn::RETURNS,
    }
}
