//! What the loop found: everything that a report says.

use serde::{Deserialize, Serialize};

use super::model::{SensorModel, Term};
use super::screen::Screening;
use crate::effects::Channel;

/// A number with its 95 % interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// The number.
    pub value: f64,
    /// Its 95 % interval, from a block bootstrap over scenes.
    pub ci95: [f64; 2],
}

/// What the loop may no longer claim, and why; in plain words.
pub type Caveat = String;

/// What the loop found.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The model that the loop began with, its noise floor fitted.
    pub before: SensorModel,
    /// The model that it ended with.
    pub after: SensorModel,
    /// The rounds, one effect or table tried for addition each.
    pub rounds: Vec<Round>,
    /// Effects that the model gained, in the order in which they were added; declared ones are not among them.
    pub effects: Vec<Found>,
    /// Effects that the model had before, refitted.
    pub declared: Vec<Found>,
    /// What depends on something that no effect of the library explains.
    pub unexplained: Vec<Unexplained>,
    /// How the residual depended on the covariates before.
    pub screening_before: Screening,
    /// And afterwards.
    pub screening_after: Screening,
    /// What could not be told, and why.
    pub caveats: Vec<Caveat>,
}

/// One round of trying every effect that the model lacks.
#[derive(Clone, Debug, Serialize)]
pub struct Round {
    /// The candidates, best first.
    pub candidates: Vec<Candidate>,
    /// What was done, in plain words.
    pub decision: String,
}

/// One candidate of a round.
#[derive(Clone, Debug, Serialize)]
pub struct Candidate {
    /// Name of the effect, or `table` with its channel and covariates.
    pub name: String,
    /// Held-out log-likelihood that it gains, nats a ray.
    pub gain_nats_per_pixel: Interval,
    /// Benjamini–Hochberg-adjusted probability of such a gain where there is none.
    pub q_value: f64,
    /// Whether it passed everything that a claim asks for.
    pub passed: bool,
    /// What it gains where what it depends on was drawn by lot; only of those that might have been added.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub placebo_gain: Option<Interval>,
    /// Whether it was tried on a sample only, to which its gain was fitted: others gained far more, or it gained next to nothing.
    pub only_glanced: bool,
}

/// An effect that the model has, and what it is worth.
#[derive(Clone, Debug)]
pub struct Found {
    /// The effect with its parameters.
    pub term: Term,
    /// Standard errors of its physical values.
    pub stderr: Vec<f64>,
    /// Held-out log-likelihood that it gained when it was added, nats a ray.
    pub gain: Interval,
    /// Adjusted probability of such a gain where there is none.
    pub q_value: f64,
    /// Effects that explain these data as well.
    pub ties: Vec<String>,
}

/// A dependence that no effect of the library explains.
#[derive(Clone, Debug, Serialize)]
pub struct Unexplained {
    /// The channel.
    pub channel: Channel,
    /// What it depends on.
    pub covariates: Vec<String>,
    /// Share of the channel's reducible residual that a table over these covariates explains, held out.
    pub share_of_residual: f64,
    /// Adjusted probability of that where there is no dependence.
    pub q_value: f64,
    /// Whether the table is part of the model now.
    pub added_as_table: bool,
}
