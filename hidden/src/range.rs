//! Defects of range: the right surface at the wrong distance.

use lidar::Sensor;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use crate::defect::Truth;
use crate::dice::{Dice, normal, ring_pattern, sign};
use crate::sweep::Shot;

/// The right surface at the wrong distance; r is the true range. Errors add up.
///
/// In lists with one value a ring, rings past the end have no error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "defect", rename_all = "snake_case", deny_unknown_fields)]
pub enum Range {
    /// r + b.
    RangeOffset {
        /// b.
        offset_m: f64,
    },
    /// r + b of each ring.
    RangeOffsetPerRing {
        /// b of each ring.
        offset_m: Vec<f64>,
    },
    /// (1 + s)·r.
    RangeScale {
        /// s.
        scale: f64,
    },
    /// r − a·ln ρ, ρ the surface's reflectance (0.01 where it is less): a leading-edge detector sees a weak pulse late, and the edge
    /// of an exponentially rising pulse crosses the threshold later by the logarithm of its height.
    RangeWalk {
        /// a: nothing for a perfect reflector, 1.7·a for asphalt (ρ = 0.18).
        amplitude_m: f64,
    },
    /// More noise the farther away: its standard deviation σ₁·r adds in squares to that of the recipe.
    RangeNoise {
        /// σ₁.
        sigma_per_m: f64,
    },
    /// A slanted surface stretches the pulse: r + b·tan α + noise of standard deviation s·tan α; tan α is cut at 10.
    IncidenceStretch {
        /// b.
        bias_per_tan_m: f64,
        /// s.
        sigma_per_tan_m: f64,
    },
    /// The beam is split by an edge: at a jump of more than 0.5 m to the echo of a pixel above, below, left or right, the range is
    /// w·near + (1 − w)·far, w uniform in 0–1. Where several neighbours jump, one of them is drawn.
    MixedPixels {
        /// How often a ray at such a jump is mixed.
        probability: f64,
    },
    /// The reported range, noise included, is a multiple of q: q·round(r / q).
    Quantisation {
        /// q.
        step_m: f64,
    },
}

/// Reflectances below this walk no farther.
const DARKEST: f64 = 0.01;

/// tan α goes no higher, about 84°.
const MAX_TAN: f64 = 10.0;

/// What counts as an edge.
const EDGE_M: f64 = 0.5;

impl Range {
    /// Names, as in the effect library.
    pub(crate) const NAMES: &[&str] = &[
        "range_offset",
        "range_offset_per_ring",
        "range_scale",
        "range_walk",
        "range_noise",
        "incidence_stretch",
        "mixed_pixels",
        "quantisation",
    ];

    pub(crate) fn name(&self) -> &'static str {
        Self::NAMES[match self {
            Self::RangeOffset { .. } => 0,
            Self::RangeOffsetPerRing { .. } => 1,
            Self::RangeScale { .. } => 2,
            Self::RangeWalk { .. } => 3,
            Self::RangeNoise { .. } => 4,
            Self::IncidenceStretch { .. } => 5,
            Self::MixedPixels { .. } => 6,
            Self::Quantisation { .. } => 7,
        }]
    }

    pub(crate) fn truth(&self) -> Truth {
        match self {
            Self::RangeOffset { offset_m } => vec![("offset_m", *offset_m)],
            Self::RangeOffsetPerRing { offset_m } => offset_m.iter().map(|offset| ("offset_m", *offset)).collect(),
            Self::RangeScale { scale } => vec![("scale", *scale)],
            Self::RangeWalk { amplitude_m } => vec![("amplitude_m", *amplitude_m)],
            Self::RangeNoise { sigma_per_m } => vec![("sigma_per_m", *sigma_per_m)],
            Self::IncidenceStretch { bias_per_tan_m, sigma_per_tan_m } => {
                vec![("bias_per_tan_m", *bias_per_tan_m), ("sigma_per_tan_m", *sigma_per_tan_m)]
            }
            Self::MixedPixels { probability } => vec![("probability", *probability)],
            Self::Quantisation { step_m } => vec![("step_m", *step_m)],
        }
    }

    /// Size 1: lasers of an HDL-64E differ by 1–10 cm, and it is specified to 2 cm at all ranges.
    pub(crate) fn typical(name: &str, size: f64, sensor: &Sensor, dice: &mut dyn Rng) -> Option<Self> {
        Some(match name {
            "range_offset" => Self::RangeOffset { offset_m: 0.05 * size * sign(dice) },
            "range_offset_per_ring" => {
                Self::RangeOffsetPerRing { offset_m: ring_pattern(sensor.rings().len(), 0.04 * size, dice) }
            }
            "range_scale" => Self::RangeScale { scale: 0.003 * size * sign(dice) },
            "range_walk" => Self::RangeWalk { amplitude_m: 0.02 * size * sign(dice) },
            "range_noise" => Self::RangeNoise { sigma_per_m: 0.0015 * size },
            "incidence_stretch" => {
                Self::IncidenceStretch { bias_per_tan_m: 0.01 * size, sigma_per_tan_m: 0.005 * size }
            }
            "mixed_pixels" => Self::MixedPixels { probability: (0.3 * size).min(1.0) },
            "quantisation" => Self::Quantisation { step_m: 0.02 * size },
            _ => return None,
        })
    }

    /// What it adds to the range of a ray.
    pub(crate) fn error_m(&self, shot: &Shot, dice: &mut Dice) -> f64 {
        let echo = &shot.echo;
        match self {
            Self::RangeOffset { offset_m } => *offset_m,
            Self::RangeOffsetPerRing { offset_m } => offset_m.get(shot.ray.ring).copied().unwrap_or(0.0),
            Self::RangeScale { scale } => scale * echo.range_m,
            Self::RangeWalk { amplitude_m } => -amplitude_m * echo.reflectance.max(DARKEST).ln(),
            Self::RangeNoise { sigma_per_m } => sigma_per_m * echo.range_m * normal(dice),
            Self::IncidenceStretch { bias_per_tan_m, sigma_per_tan_m } => {
                echo.incidence_rad.tan().clamp(0.0, MAX_TAN) * (bias_per_tan_m + sigma_per_tan_m * normal(dice))
            }
            Self::MixedPixels { probability } => mixing_error_m(shot, *probability, dice),
            Self::Quantisation { .. } => 0.0,
        }
    }
}

/// Draws the same amount of random numbers at every edge, mixed or not, so that two probabilities differ in nothing else.
fn mixing_error_m(shot: &Shot, probability: f64, dice: &mut Dice) -> f64 {
    let own_m = shot.echo.range_m;
    let others_m: Vec<f64> = (shot.sweep.neighbours(shot.ray.pixel))
        .map(|echo| echo.range_m)
        .filter(|other_m| (other_m - own_m).abs() > EDGE_M)
        .collect();
    if others_m.is_empty() {
        return 0.0;
    }
    let other_m = others_m[dice.random_range(0..others_m.len())];
    let (mixes, share) = (dice.random::<f64>() < probability, dice.random::<f64>());
    if mixes { share * (other_m - own_m) } else { 0.0 }
}
