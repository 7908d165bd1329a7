//! Defects of reflectance: the right surface, too bright or too dark.

use lidar::Sensor;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use crate::defect::Truth;
use crate::dice::ring_pattern;
use crate::sweep::Shot;

/// The right surface, too bright or too dark; ρ is its reflectance, r its true range, α the angle of incidence. Factors multiply.
///
/// In lists with one value a ring, rings past the end have no error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "defect", rename_all = "snake_case", deny_unknown_fields)]
pub enum Reflectance {
    /// Each laser and its detector have a gain and an offset of their own: g·I + o, after everything that weakens the light.
    RingGain {
        /// g of each ring.
        gain: Vec<f64>,
        /// o of each ring.
        offset: Vec<f64>,
    },
    /// ρ·η(r)·e^{−2βr}: what the calibration by range left over.
    ReflectanceFalloff {
        /// β.
        beta_per_m: f64,
        /// r₀ of the overlap of beam and detector's view at short range, η = 1 − e^{−(r/r₀)²}; 0 for η = 1.
        overlap_m: f64,
    },
    /// ρ·cosᵖ α: p = 1 is Lambert's law.
    IncidenceFalloff {
        /// p.
        exponent: f64,
    },
    /// Nothing brighter is reported: min(I, maximum), noise included.
    Saturation {
        /// The brightest.
        maximum: f64,
    },
}

impl Reflectance {
    /// Names, as in the effect library.
    pub(crate) const NAMES: &[&str] = &["ring_gain", "reflectance_falloff", "incidence_falloff", "saturation"];

    pub(crate) fn name(&self) -> &'static str {
        Self::NAMES[match self {
            Self::RingGain { .. } => 0,
            Self::ReflectanceFalloff { .. } => 1,
            Self::IncidenceFalloff { .. } => 2,
            Self::Saturation { .. } => 3,
        }]
    }

    pub(crate) fn truth(&self) -> Truth {
        match self {
            Self::RingGain { gain, offset } => {
                gain.iter().map(|g| ("gain", *g)).chain(offset.iter().map(|o| ("offset", *o))).collect()
            }
            Self::ReflectanceFalloff { beta_per_m, overlap_m } => {
                vec![("beta_per_m", *beta_per_m), ("overlap_m", *overlap_m)]
            }
            Self::IncidenceFalloff { exponent } => vec![("exponent", *exponent)],
            Self::Saturation { maximum } => vec![("maximum", *maximum)],
        }
    }

    /// Size 1: lasers that differ by a tenth, a tenth lost every 10 m, half of Lambert's law, paint and signs alike.
    pub(crate) fn typical(name: &str, size: f64, sensor: &Sensor, dice: &mut dyn Rng) -> Option<Self> {
        let rings = sensor.rings().len();
        Some(match name {
            "ring_gain" => Self::RingGain {
                gain: ring_pattern(rings, 0.1 * size, dice).into_iter().map(|g| 1.0 + g).collect(),
                offset: ring_pattern(rings, 0.01 * size, dice),
            },
            "reflectance_falloff" => Self::ReflectanceFalloff {
                beta_per_m: 0.005 * size,
                overlap_m: if dice.random_bool(0.3) { 4.0 * size } else { 0.0 },
            },
            "incidence_falloff" => Self::IncidenceFalloff { exponent: 0.5 * size },
            "saturation" => Self::Saturation { maximum: (-0.6 * size).exp() },
            _ => return None,
        })
    }

    /// The share of the light that is left.
    pub(crate) fn factor(&self, shot: &Shot) -> f64 {
        let echo = &shot.echo;
        match self {
            Self::ReflectanceFalloff { beta_per_m, overlap_m } => {
                let seen = if *overlap_m > 0.0 { -(-(echo.range_m / overlap_m).powi(2)).exp_m1() } else { 1.0 };
                seen * (-2.0 * beta_per_m * echo.range_m).exp()
            }
            Self::IncidenceFalloff { exponent } => echo.incidence_rad.cos().max(0.0).powf(*exponent),
            Self::RingGain { .. } | Self::Saturation { .. } => 1.0,
        }
    }

    /// What a ring's electronics make of a reflectance.
    pub(crate) fn amplified(&self, ring: usize, reflectance: f64) -> f64 {
        let Self::RingGain { gain, offset } = self else { return reflectance };
        gain.get(ring).unwrap_or(&1.0) * reflectance + offset.get(ring).unwrap_or(&0.0)
    }
}
