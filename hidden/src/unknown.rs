//! Defects that no library has a name for: the loop must say that something is there, and what it depends on.

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use crate::defect::{Channel, Truth};
use crate::dice::{Dice, sign};
use crate::sweep::{Ray, Shot};

/// Defects that no library has a name for; r is the true range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "defect", rename_all = "snake_case", deny_unknown_fields)]
pub enum Unknown {
    /// Ranges are longer in a part of the sweep and right in the rest: r + b where the phase is within the width of a start.
    RangeBySweepPhase {
        /// b.
        offset_m: f64,
        /// Share of the turn that is over where the part begins.
        from: f64,
        /// Its length as a share of the turn; it may run over the seam.
        width: f64,
    },
    /// r + b of the class: what lies behind the surface, a leaf's depth, a coat of paint.
    RangeByClass {
        /// b of each class of the learning map, 20 of them.
        offset_m: Vec<f64>,
    },
    /// r + b·e^{−(r − r₀)²/2w²}: right at near and far.
    RangeMidBump {
        /// b.
        offset_m: f64,
        /// r₀.
        centre_m: f64,
        /// w.
        width_m: f64,
    },
    /// r ± s·(r − r₀), plus on even rings and minus on odd ones: neither ring nor range alone shows it.
    RangeByRingAndRange {
        /// s.
        scale: f64,
        /// r₀.
        centre_m: f64,
    },
    /// Reflectance times 1 + g·e^{−(θ − θ₀)²/2w²}: a smear on the window that brightens or darkens.
    ReflectanceAzimuthBump {
        /// g.
        gain: f64,
        /// θ₀.
        centre_deg: f64,
        /// w.
        width_deg: f64,
    },
    /// Echoes from a layer above the ground are lost more often.
    DropByHeight {
        /// How much more often.
        drop: f64,
        /// Height of the layer's lower edge above the ground.
        from_m: f64,
        /// Height of its upper edge.
        to_m: f64,
    },
    /// Echoes of some classes are lost more often, at whatever range and angle.
    DropByClass {
        /// How much more often, for each class of the learning map, 20 of them.
        drop: Vec<f64>,
    },
    /// Echoes of middling surfaces are lost more often than those of dark and of bright ones: p·e^{−(ρ − ρ₀)²/2w²}.
    DropByReflectance {
        /// p.
        drop: f64,
        /// ρ₀.
        centre: f64,
        /// w.
        width: f64,
    },
}

/// Classes whose number of points in a street is large: building, vegetation, terrain.
const COMMON_SOLID: [usize; 3] = [13, 15, 17];

impl Unknown {
    /// Names; the library has none of them.
    pub(crate) const NAMES: &[&str] = &[
        "range_by_sweep_phase",
        "range_by_class",
        "range_mid_bump",
        "range_by_ring_and_range",
        "reflectance_azimuth_bump",
        "drop_by_height",
        "drop_by_class",
        "drop_by_reflectance",
    ];

    pub(crate) fn name(&self) -> &'static str {
        Self::NAMES[match self {
            Self::RangeBySweepPhase { .. } => 0,
            Self::RangeByClass { .. } => 1,
            Self::RangeMidBump { .. } => 2,
            Self::RangeByRingAndRange { .. } => 3,
            Self::ReflectanceAzimuthBump { .. } => 4,
            Self::DropByHeight { .. } => 5,
            Self::DropByClass { .. } => 6,
            Self::DropByReflectance { .. } => 7,
        }]
    }

    /// The one channel that it changes.
    pub fn channel(&self) -> Channel {
        *self.channel_ref()
    }

    pub(crate) fn channel_ref(&self) -> &'static Channel {
        match self {
            Self::RangeBySweepPhase { .. }
            | Self::RangeByClass { .. }
            | Self::RangeMidBump { .. }
            | Self::RangeByRingAndRange { .. } => &Channel::Range,
            Self::ReflectanceAzimuthBump { .. } => &Channel::Reflectance,
            Self::DropByHeight { .. } | Self::DropByClass { .. } | Self::DropByReflectance { .. } => &Channel::Missing,
        }
    }

    /// What it depends on: each entry is one covariate, by all the names that fit it.
    ///
    /// In a single sweep azimuth and phase are the same number, so both names are right for either.
    pub fn covariates(&self) -> &'static [&'static [&'static str]] {
        match self {
            Self::RangeBySweepPhase { .. } => &[&["sweep_phase", "azimuth"]],
            Self::RangeByClass { .. } | Self::DropByClass { .. } => &[&["class"]],
            Self::RangeMidBump { .. } => &[&["range"]],
            Self::RangeByRingAndRange { .. } => &[&["ring"], &["range"]],
            Self::ReflectanceAzimuthBump { .. } => &[&["azimuth", "sweep_phase"]],
            Self::DropByHeight { .. } => &[&["height"]],
            Self::DropByReflectance { .. } => &[&["reflectance"]],
        }
    }

    pub(crate) fn truth(&self) -> Truth {
        match self {
            Self::RangeBySweepPhase { offset_m, from, width } => {
                vec![("offset_m", *offset_m), ("from", *from), ("width", *width)]
            }
            Self::RangeByClass { offset_m } => offset_m.iter().map(|offset| ("offset_m", *offset)).collect(),
            Self::RangeMidBump { offset_m, centre_m, width_m } => {
                vec![("offset_m", *offset_m), ("centre_m", *centre_m), ("width_m", *width_m)]
            }
            Self::RangeByRingAndRange { scale, centre_m } => vec![("scale", *scale), ("centre_m", *centre_m)],
            Self::ReflectanceAzimuthBump { gain, centre_deg, width_deg } => {
                vec![("gain", *gain), ("centre_deg", *centre_deg), ("width_deg", *width_deg)]
            }
            Self::DropByHeight { drop, from_m, to_m } => vec![("drop", *drop), ("from_m", *from_m), ("to_m", *to_m)],
            Self::DropByClass { drop } => drop.iter().map(|share| ("drop", *share)).collect(),
            Self::DropByReflectance { drop, centre, width } => {
                vec![("drop", *drop), ("centre", *centre), ("width", *width)]
            }
        }
    }

    /// Size 1: as large as what the library's effects do.
    pub(crate) fn typical(name: &str, size: f64, dice: &mut dyn Rng) -> Option<Self> {
        Some(match name {
            "range_by_sweep_phase" => Self::RangeBySweepPhase {
                offset_m: 0.06 * size * sign(dice),
                from: dice.random(),
                width: dice.random_range(0.1..0.3),
            },
            "range_by_class" => {
                let sign = sign(dice);
                let mut offset_m = vec![0.0; lidar::label::CLASSES];
                for (k, class) in COMMON_SOLID.into_iter().enumerate() {
                    offset_m[class] = 0.05 * size * if k % 2 == 0 { sign } else { -sign };
                }
                Self::RangeByClass { offset_m }
            }
            "range_mid_bump" => Self::RangeMidBump {
                offset_m: 0.08 * size * sign(dice),
                centre_m: dice.random_range(12.0..22.0),
                width_m: dice.random_range(2.5..4.0),
            },
            "range_by_ring_and_range" => Self::RangeByRingAndRange { scale: 0.005 * size * sign(dice), centre_m: 15.0 },
            "reflectance_azimuth_bump" => Self::ReflectanceAzimuthBump {
                gain: 0.4 * size * sign(dice),
                centre_deg: dice.random_range(-180.0..180.0),
                width_deg: dice.random_range(10.0..25.0),
            },
            "drop_by_height" => Self::DropByHeight { drop: (0.3 * size).min(1.0), from_m: 0.5, to_m: 2.0 },
            "drop_by_class" => {
                let mut drop = vec![0.0; lidar::label::CLASSES];
                drop[COMMON_SOLID[dice.random_range(0..COMMON_SOLID.len())]] = (0.25 * size).min(1.0);
                Self::DropByClass { drop }
            }
            "drop_by_reflectance" => Self::DropByReflectance {
                drop: (0.35 * size).min(1.0),
                centre: dice.random_range(0.3..0.42),
                width: 0.04,
            },
            _ => return None,
        })
    }

    /// What it adds to the range of a ray.
    pub(crate) fn error_m(&self, shot: &Shot) -> f64 {
        let range_m = shot.echo.range_m;
        match self {
            Self::RangeBySweepPhase { offset_m, from, width } => {
                offset_m * inside((shot.ray.phase - from).rem_euclid(1.0), 0.0..*width)
            }
            Self::RangeByClass { offset_m } => offset_m.get(usize::from(shot.echo.class)).copied().unwrap_or(0.0),
            Self::RangeMidBump { offset_m, centre_m, width_m } => offset_m * bell(range_m - centre_m, *width_m),
            Self::RangeByRingAndRange { scale, centre_m } => {
                let sign = if shot.ray.ring.is_multiple_of(2) { 1.0 } else { -1.0 };
                sign * scale * (range_m - centre_m)
            }
            _ => 0.0,
        }
    }

    /// The share of the light that is left.
    pub(crate) fn factor(&self, ray: &Ray) -> f64 {
        let Self::ReflectanceAzimuthBump { gain, centre_deg, width_deg } = self else { return 1.0 };
        let away_deg = (ray.azimuth_rad.to_degrees() - centre_deg + 180.0).rem_euclid(360.0) - 180.0;
        1.0 + gain * bell(away_deg, *width_deg)
    }

    /// Whether the echo of a ray is lost.
    pub(crate) fn loses(&self, shot: &Shot, dice: &mut Dice) -> bool {
        let u: f64 = dice.random();
        let drop = match self {
            Self::DropByHeight { drop, from_m, to_m } => drop * inside(shot.height_m(), *from_m..*to_m),
            Self::DropByClass { drop } => drop.get(usize::from(shot.echo.class)).copied().unwrap_or(0.0),
            Self::DropByReflectance { drop, centre, width } => drop * bell(shot.echo.reflectance - centre, *width),
            _ => 0.0,
        };
        u < drop
    }
}

/// 1 inside, 0 outside.
fn inside(value: f64, span: std::ops::Range<f64>) -> f64 {
    f64::from(u8::from(span.contains(&value)))
}

/// A Gaussian of height 1.
fn bell(away: f64, width: f64) -> f64 {
    (-0.5 * (away / width).powi(2)).exp()
}
