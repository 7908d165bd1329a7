//! What kind of street to make up.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::Dice;

/// Least and greatest value of something that each seed picks anew.
pub type Span = [f32; 2];

/// What a street may be like; every seed picks one value from each span. An empty file means the defaults.
///
/// Values outside what is said here are moved to the nearest that is inside.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StreetConfig {
    /// How far the street goes on ahead of and behind the sensor: 40 to 500 m.
    pub reach_m: f32,
    /// Width of a lane: 2.9 to 4.5 m.
    pub lane_width_m: Span,
    /// Sharpest bend, one over its radius: 0 to 0.005 per metre.
    pub curvature_per_m: Span,
    /// Steepest slope along the street: 0 to 0.1.
    pub slope: Span,
    /// Unevenness of the ground off the road: 0 to 0.3 m.
    pub roughness_m: Span,
    /// Side streets in 100 m: 0 to 3.
    pub side_streets_per_100_m: Span,
    /// Share of the frontage that is built on: 0 to 1.
    pub built_share: Span,
    /// Share of parking bays that are taken: 0 to 1.
    pub parked_share: Span,
    /// Vehicles on 100 m of a lane: 0 to 6.
    pub vehicles_per_100_m: Span,
    /// People on 100 m of a pavement: 0 to 20.
    pub people_per_100_m: Span,
    /// Trees on 100 m of a side: 0 to 12.
    pub trees_per_100_m: Span,
}

impl Default for StreetConfig {
    fn default() -> Self {
        Self {
            reach_m: 160.0,
            lane_width_m: [2.9, 3.6],
            curvature_per_m: [0.0, 0.004],
            slope: [0.0, 0.03],
            roughness_m: [0.01, 0.07],
            side_streets_per_100_m: [0.4, 1.4],
            built_share: [0.4, 1.0],
            parked_share: [0.15, 0.85],
            vehicles_per_100_m: [0.6, 2.8],
            people_per_100_m: [1.0, 6.0],
            trees_per_100_m: [2.0, 7.0],
        }
    }
}

impl StreetConfig {
    /// The same, every number within what the street can be.
    pub(super) fn bounded(&self) -> Self {
        // `max` before `min`: NaN becomes the lower bound.
        let bound = |value: f32, low: f32, high: f32| value.max(low).min(high);
        let span = |value: Span, low: f32, high: f32| value.map(|v| bound(v, low, high));
        Self {
            reach_m: bound(self.reach_m, 40.0, 500.0),
            lane_width_m: span(self.lane_width_m, 2.9, 4.5),
            curvature_per_m: span(self.curvature_per_m, 0.0, 0.005),
            slope: span(self.slope, 0.0, 0.1),
            roughness_m: span(self.roughness_m, 0.0, 0.3),
            side_streets_per_100_m: span(self.side_streets_per_100_m, 0.0, 3.0),
            built_share: span(self.built_share, 0.0, 1.0),
            parked_share: span(self.parked_share, 0.0, 1.0),
            vehicles_per_100_m: span(self.vehicles_per_100_m, 0.0, 6.0),
            people_per_100_m: span(self.people_per_100_m, 0.0, 20.0),
            trees_per_100_m: span(self.trees_per_100_m, 0.0, 12.0),
        }
    }
}

/// A value from a span.
pub(super) fn pick(span: Span, dice: &mut Dice) -> f32 {
    span[0] + (span[1] - span[0]) * dice.random::<f32>()
}
