//! What was tried and what was found.

use serde::Serialize;

use super::Over;
use super::noise::Noise;
use super::parts::Parts;
use crate::closed_loop::outcome::{Caveat, Found, Interval, Unexplained};
use crate::closed_loop::report::Verdict;

/// What to keep in mind of each effect.
const CAVEATS: [(Over, &str); 4] = [
    (
        Over::Ring,
        "gains are known but for what changes smoothly with elevation, for so do the surfaces of a street; range and angle were only read \
                  from each ring by itself",
    ),
    (
        Over::Range,
        "the real places may be darker or brighter far away, other than the simulated ones: without twins this looks like a fall-off",
    ),
    (
        Over::Incidence,
        "the real surfaces that are seen from the side may be others than the simulated ones: without twins this looks like a fall-off",
    ),
    (
        Over::Power,
        "the expected power is that of the neighbouring returns, so its error is part of the softness, and the power at which half of the \
                   returns are lost is extrapolated if fewer are; reflectances were only compared where nine in ten returns of a dark surface are strong enough",
    ),
];

/// Everything that a comparison came to.
#[derive(Clone, Debug)]
pub struct Finding {
    /// The measured half's noise floor, which the simulated half was given.
    pub noise: Noise,
    /// Scenes, simulated and measured.
    pub scenes: [usize; 2],
    /// How many of them were opened once, at the end.
    pub confirm: [usize; 2],
    /// What was tried, in order.
    pub tried: Vec<Tried>,
    /// What could not be told, and why.
    pub caveats: Vec<Caveat>,
}

/// One effect that was tried.
#[derive(Clone, Debug)]
pub struct Tried {
    /// Where it would show.
    pub over: Over,
    /// How much better each half's own coefficients predict held-out scenes than the other half's, nats a cell.
    pub gain: Interval,
    /// What 95 % of the gains stay below if scenes are called measured or simulated at random.
    pub placebo: f64,
    /// Share of these that gain as much.
    pub p: f64,
    /// The same, adjusted for all that was tried.
    pub q: f64,
    /// Size of the effect, and what it has to be.
    pub size: [f64; 2],
    /// Share of the measured half's scatter within strata that the difference between the halves explains, on all scenes.
    pub share: f64,
    /// Scatter within strata on the confirm scenes, ln reflectance or share of missing returns: before and after.
    pub residual: Option<[f64; 2]>,
    /// The effect with its numbers, if it is claimed.
    pub found: Option<Found>,
    /// A dependence as sure as a claim's that the effect's law does not describe.
    pub unexplained: Option<Unexplained>,
    /// Both halves over the covariate.
    pub curve: Curve,
}

/// Both halves over a covariate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve {
    /// Where both halves say something.
    pub points: Vec<Point>,
}

/// A ring or bin: relative reflectance, or the share of returns that is missing beyond that of the strongest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Ring, range in m, incidence in degrees, or ln P.
    pub at: f64,
    /// The simulated half.
    pub simulated: Interval,
    /// The measured half.
    pub measured: Interval,
}

impl Finding {
    pub(super) fn new(noise: Noise, tried: Vec<Tried>, notes: Vec<Caveat>, parts: &Parts) -> Self {
        let claimed = |over: Over| tried.iter().any(|tried| tried.over == over && tried.found.is_some());
        let said = |(over, caveat): (Over, &str)| claimed(over).then(|| caveat.to_owned());
        let caveats = CAVEATS.into_iter().filter_map(said).chain(notes).collect();
        let confirm = [parts.confirm[0].len(), parts.confirm[1].len()];
        Self { noise, scenes: parts.scenes, confirm, tried, caveats }
    }

    /// The effects that are claimed, in the order in which they were added.
    pub fn effects(&self) -> Vec<&Found> {
        self.tried.iter().filter_map(|tried| tried.found.as_ref()).collect()
    }

    /// What depends on something and has no name.
    pub fn unexplained(&self) -> Vec<&Unexplained> {
        self.tried.iter().filter_map(|tried| tried.unexplained.as_ref()).collect()
    }

    /// What the loop came to.
    pub fn verdict(&self) -> Verdict {
        match (self.effects().is_empty(), self.unexplained().is_empty()) {
            (false, _) => Verdict::EffectsAdded,
            (true, false) => Verdict::UnexplainedOnly,
            (true, true) => Verdict::NothingMissing,
        }
    }
}
