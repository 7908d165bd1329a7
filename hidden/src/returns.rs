//! Defects of returns: echoes that the sensor does not report, and returns that are no echoes.

use glam::DVec3;
use lidar::Sensor;
use rand::{Rng, RngExt};
use rand_distr::Exp1;
use serde::{Deserialize, Serialize};

use crate::defect::{Channel, Truth};
use crate::dice::{Dice, normal, sign};
use crate::measure::Return;
use crate::sweep::{Ray, Shot, Sweep};

/// Echoes that the sensor does not report, returns that are no echoes, and what comes with them; ρ is the surface's reflectance, r the
/// true range, α the angle of incidence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "defect", rename_all = "snake_case", deny_unknown_fields)]
pub enum Returns {
    /// Weak echoes are lost: P = ρ·cos α·e^{−2βr} / r² fades by a log-normal factor and is reported where it exceeds `P_min`, that is
    /// with probability Φ((ln P − ln `P_min`) / s). The lidar equation for a beam that the surface fills.
    WeakReturnDrop {
        /// `P_min`, in 1/m².
        p_min_per_m2: f64,
        /// s.
        softness: f64,
        /// β.
        beta_per_m: f64,
    },
    /// Wet ground (road, parking, pavement, other ground) mirrors the share w·F(α) of the light away; as many echoes are lost, and the
    /// reported ones are weaker by the same share. F: Fresnel's equations for water, unpolarised light.
    Specular {
        /// w: 0 dry, 1 under water.
        wetness: f64,
    },
    /// A bright target (ρ ≥ threshold) lights up the rays around it: one at the angle d from the nearest such target reports the
    /// target's range with probability p·e^{−d/ℓ} and a reflectance of ρ·e^{−d/ℓ}, unless what it meets is nearer.
    Blooming {
        /// p.
        probability: f64,
        /// ℓ.
        length_deg: f64,
        /// Reflectance from which a target is bright.
        threshold: f64,
    },
    /// Crosstalk and sunlight: any ray, whatever it meets, reports a range uniform within the sensor's limits and a reflectance
    /// uniform in 0–1.
    RandomReturns {
        /// How often.
        probability: f64,
    },
    /// Dirt or a mount in the way: rays of this sector are lost.
    BlockedSector {
        /// Azimuth of the sector's right edge.
        from_deg: f64,
        /// Azimuth of its left edge; the sector runs to the left from `from_deg`, through 180° where this is less.
        to_deg: f64,
        /// Share of its rays that is lost.
        drop: f64,
        /// First and last ring that it covers; all where there are none.
        #[serde(default)]
        rings: Option<[usize; 2]>,
    },
    /// Nothing nearer or farther is reported, noise included.
    RangeLimits {
        /// The nearest.
        minimum_m: f64,
        /// The farthest.
        maximum_m: f64,
    },
    /// Rain and snow: the first particle in a ray's way is reported instead of what is behind it, dimly (reflectance uniform in
    /// 0.01–0.06). Particles are seen at c·e^{−r/ℓ} a metre: near ones alone send enough light back.
    Precipitation {
        /// c.
        probability_per_m: f64,
        /// ℓ.
        reach_m: f64,
    },
    /// Fog: light is weaker by e^{−2αr} and as many echoes are lost (Beer and Lambert).
    Fog {
        /// α.
        alpha_per_m: f64,
    },
    /// The sensor warms up: frame n of the set, from 0, has ranges longer by b·n and reflectances of (1 + g·n) times the first's.
    Drift {
        /// b.
        range_m_per_frame: f64,
        /// g.
        gain_per_frame: f64,
    },
}

/// Classes of the learning map that water can stand on: road, parking, pavement, other ground.
const PAVED: std::ops::RangeInclusive<u8> = 9..=12;

/// Refractive index of water in the near infrared.
const WATER: f64 = 1.33;

/// Blooming ends after so many lengths, where less than a hundredth is left.
const BLOOM_LENGTHS: f64 = 5.0;

/// Reflectance of a drop or a flake.
const PARTICLE: std::ops::Range<f64> = 0.01..0.06;

impl Returns {
    /// Names, as in the effect library.
    pub(crate) const NAMES: &[&str] = &[
        "weak_return_drop",
        "specular",
        "blooming",
        "random_returns",
        "blocked_sector",
        "range_limits",
        "precipitation",
        "fog",
        "drift",
    ];

    pub(crate) fn name(&self) -> &'static str {
        Self::NAMES[match self {
            Self::WeakReturnDrop { .. } => 0,
            Self::Specular { .. } => 1,
            Self::Blooming { .. } => 2,
            Self::RandomReturns { .. } => 3,
            Self::BlockedSector { .. } => 4,
            Self::RangeLimits { .. } => 5,
            Self::Precipitation { .. } => 6,
            Self::Fog { .. } => 7,
            Self::Drift { .. } => 8,
        }]
    }

    pub(crate) fn channels(&self) -> &'static [Channel] {
        match self {
            Self::WeakReturnDrop { .. } | Self::BlockedSector { .. } | Self::RangeLimits { .. } => &[Channel::Missing],
            Self::Specular { .. } | Self::Fog { .. } => &[Channel::Reflectance, Channel::Missing],
            Self::Drift { .. } => &[Channel::Range, Channel::Reflectance],
            Self::Blooming { .. } | Self::RandomReturns { .. } | Self::Precipitation { .. } => &[Channel::Extra],
        }
    }

    pub(crate) fn truth(&self) -> Truth {
        match self {
            Self::WeakReturnDrop { p_min_per_m2, softness, beta_per_m } => {
                vec![("p_min_per_m2", *p_min_per_m2), ("softness", *softness), ("beta_per_m", *beta_per_m)]
            }
            Self::Specular { wetness } => vec![("wetness", *wetness)],
            Self::Blooming { probability, length_deg, threshold } => {
                vec![("probability", *probability), ("length_deg", *length_deg), ("threshold", *threshold)]
            }
            Self::RandomReturns { probability } => vec![("probability", *probability)],
            Self::BlockedSector { from_deg, to_deg, drop, rings } => {
                let of_rings = rings.map(|[first, last]| [("first_ring", first as f64), ("last_ring", last as f64)]);
                let sector = [("from_deg", *from_deg), ("to_deg", *to_deg), ("drop", *drop)];
                sector.into_iter().chain(of_rings.into_iter().flatten()).collect()
            }
            Self::RangeLimits { minimum_m, maximum_m } => vec![("minimum_m", *minimum_m), ("maximum_m", *maximum_m)],
            Self::Precipitation { probability_per_m, reach_m } => {
                vec![("probability_per_m", *probability_per_m), ("reach_m", *reach_m)]
            }
            Self::Fog { alpha_per_m } => vec![("alpha_per_m", *alpha_per_m)],
            Self::Drift { range_m_per_frame, gain_per_frame } => {
                vec![("range_m_per_frame", *range_m_per_frame), ("gain_per_frame", *gain_per_frame)]
            }
        }
    }

    /// Size 1: asphalt is lost from about 28 m, a mount of 20°, light rain or snow, fog in which one sees 1 km.
    pub(crate) fn typical(name: &str, size: f64, sensor: &Sensor, dice: &mut dyn Rng) -> Option<Self> {
        let (nearest_m, farthest_m) = sensor.range_limits_m();
        let rings = sensor.rings().len();
        Some(match name {
            "weak_return_drop" => {
                Self::WeakReturnDrop { p_min_per_m2: 1.5e-5 * size, softness: 0.5, beta_per_m: 0.002 }
            }
            "specular" => Self::Specular { wetness: (0.7 * size).min(1.0) },
            "blooming" => Self::Blooming { probability: (0.8 * size).min(1.0), length_deg: 1.5, threshold: 0.85 },
            "random_returns" => Self::RandomReturns { probability: (0.01 * size).min(1.0) },
            "blocked_sector" => {
                let from_deg = dice.random_range(-180.0..180.0);
                let first = dice.random_range(0..=rings / 2);
                Self::BlockedSector {
                    from_deg,
                    to_deg: wrapped_deg(from_deg + (20.0 * size).min(180.0)),
                    drop: 0.9,
                    rings: dice.random_bool(0.5).then_some([first, (first + rings / 2).min(rings - 1)]),
                }
            }
            "range_limits" => Self::RangeLimits {
                minimum_m: f64::from(nearest_m) + 4.0 * size,
                maximum_m: f64::from(farthest_m) * (-0.7 * size).exp(),
            },
            "precipitation" => {
                let (probability_per_m, reach_m) = if dice.random() { (0.003, 5.0) } else { (0.003, 12.0) };
                Self::Precipitation { probability_per_m: probability_per_m * size, reach_m }
            }
            "fog" => Self::Fog { alpha_per_m: 0.004 * size },
            "drift" => {
                Self::Drift { range_m_per_frame: 0.004 * size * sign(dice), gain_per_frame: 0.008 * size * sign(dice) }
            }
            _ => return None,
        })
    }

    /// What it adds to the range of a ray.
    pub(crate) fn error_m(&self, shot: &Shot) -> f64 {
        match self {
            Self::Drift { range_m_per_frame, .. } => range_m_per_frame * shot.sweep.frame as f64,
            _ => 0.0,
        }
    }

    /// The share of the light that is left.
    pub(crate) fn factor(&self, shot: &Shot) -> f64 {
        match self {
            Self::Specular { wetness } => 1.0 - mirrored(*wetness, shot),
            Self::Fog { alpha_per_m } => (-2.0 * alpha_per_m * shot.echo.range_m).exp(),
            Self::Drift { gain_per_frame, .. } => 1.0 + gain_per_frame * shot.sweep.frame as f64,
            _ => 1.0,
        }
    }

    /// Whether the echo of a ray is lost.
    pub(crate) fn loses(&self, shot: &Shot, dice: &mut Dice) -> bool {
        let echo = &shot.echo;
        match self {
            Self::WeakReturnDrop { p_min_per_m2, softness, beta_per_m } => {
                let power_per_m2 =
                    echo.reflectance * echo.incidence_rad.cos() * (-2.0 * beta_per_m * echo.range_m).exp()
                        / echo.range_m.powi(2);
                power_per_m2.ln() + softness * normal(dice) <= p_min_per_m2.ln()
            }
            Self::Specular { wetness } => dice.random::<f64>() < mirrored(*wetness, shot),
            Self::Fog { alpha_per_m } => dice.random::<f64>() >= (-2.0 * alpha_per_m * echo.range_m).exp(),
            _ => false,
        }
    }

    /// Returns that are no echoes of what their rays aim at, by pixel.
    pub(crate) fn ghosts(&self, sweep: &Sweep, dice: &mut Dice) -> Vec<(usize, Return)> {
        let (nearest_m, farthest_m) = sweep.sensor.range_limits_m();
        let limits_m = [f64::from(nearest_m), f64::from(farthest_m)];
        let pixels = sweep.echoes().iter().enumerate();
        match *self {
            Self::RandomReturns { probability } => pixels
                .filter_map(|(pixel, _)| {
                    let [u, range, reflectance] = dice.random::<[f64; 3]>();
                    let range_m = limits_m[0] + range * (limits_m[1] - limits_m[0]);
                    (u < probability).then_some((pixel, Return { range_m, reflectance }))
                })
                .collect(),
            Self::Precipitation { probability_per_m, reach_m } => pixels
                .filter_map(|(pixel, echo)| {
                    let (depth, reflectance) = (dice.sample::<f64, _>(Exp1), dice.random_range(PARTICLE));
                    // Particles met up to r, on average, are c·ℓ·(e^{−r₀/ℓ} − e^{−r/ℓ}); the first comes after `depth` of them.
                    let left = (-limits_m[0] / reach_m).exp() - depth / (probability_per_m * reach_m);
                    let range_m = -reach_m * left.ln();
                    let end_m = echo.map_or(limits_m[1], |echo| echo.range_m);
                    (left > 0.0 && range_m < end_m).then_some((pixel, Return { range_m, reflectance }))
                })
                .collect(),
            Self::Blooming { probability, length_deg, threshold } => {
                let targets = bright(sweep, threshold);
                let length_rad = length_deg.to_radians();
                pixels
                    .filter_map(|(pixel, echo)| {
                        let (u, direction) = (dice.random::<f64>(), direction(sweep, pixel));
                        let (cosine, target) = (targets.iter())
                            .map(|target| (target.direction.dot(direction), target))
                            .max_by(|a, b| a.0.total_cmp(&b.0))?;
                        let away = cosine.min(1.0).acos() / length_rad;
                        let hidden = echo.is_some_and(|echo| echo.range_m <= target.range_m);
                        let glows = !hidden && away < BLOOM_LENGTHS && u < probability * (-away).exp();
                        let reflectance = target.reflectance * (-away).exp();
                        glows.then_some((pixel, Return { range_m: target.range_m, reflectance }))
                    })
                    .collect()
            }
            _ => Vec::new(),
        }
    }

    /// Whether something on the sensor itself is in a ray's way.
    pub(crate) fn blocks(&self, ray: &Ray, dice: &mut Dice) -> bool {
        let Self::BlockedSector { from_deg, to_deg, drop, rings } = self else { return false };
        let u: f64 = dice.random();
        let left_of = |azimuth_deg: f64| (azimuth_deg - from_deg).rem_euclid(360.0);
        let covered = rings.is_none_or(|[first, last]| (first..=last).contains(&ray.ring));
        covered && left_of(ray.azimuth_rad.to_degrees()) < left_of(*to_deg) && u < *drop
    }
}

/// The share of light that wet ground mirrors away.
fn mirrored(wetness: f64, shot: &Shot) -> f64 {
    if PAVED.contains(&shot.echo.class) { wetness * fresnel(shot.echo.incidence_rad) } else { 0.0 }
}

/// Share of unpolarised light that a surface of water mirrors (Fresnel).
fn fresnel(incidence_rad: f64) -> f64 {
    let outside = incidence_rad.cos().max(0.0);
    let inside = (1.0 - (incidence_rad.sin() / WATER).powi(2)).sqrt();
    let across = ((outside - WATER * inside) / (outside + WATER * inside)).powi(2);
    let along = ((inside - WATER * outside) / (inside + WATER * outside)).powi(2);
    0.5 * (across + along)
}

/// A surface bright enough to bloom.
struct Target {
    direction: DVec3,
    range_m: f64,
    reflectance: f64,
}

fn bright(sweep: &Sweep, threshold: f64) -> Vec<Target> {
    let echoes = sweep.echoes().iter().enumerate();
    let bright = echoes.filter_map(|(pixel, echo)| Some((pixel, echo.filter(|e| e.reflectance >= threshold)?)));
    bright
        .map(|(pixel, echo)| Target {
            direction: direction(sweep, pixel),
            range_m: echo.range_m,
            reflectance: echo.reflectance,
        })
        .collect()
}

fn direction(sweep: &Sweep, pixel: usize) -> DVec3 {
    let columns = sweep.sensor.columns();
    DVec3::from_array(sweep.sensor.direction(pixel / columns, pixel % columns))
}

/// An angle in −180°–180°.
fn wrapped_deg(angle_deg: f64) -> f64 {
    (angle_deg + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn water_mirrors_two_hundredths_head_on_and_everything_at_grazing() {
        // ((n − 1) / (n + 1))² = 0.02006 for n = 1.33.
        assert!((fresnel(0.0) - 0.020_06).abs() < 1e-5);
        assert!((fresnel(std::f64::consts::FRAC_PI_2) - 1.0).abs() < 1e-9);
        assert!((60..90).all(|a| fresnel(f64::from(a).to_radians()) < fresnel(f64::from(a + 1).to_radians())));
    }

    #[test]
    fn a_sector_may_run_through_straight_behind() {
        let sector = Returns::BlockedSector { from_deg: 170.0, to_deg: -170.0, drop: 1.0, rings: None };
        let blocks = |azimuth_deg: f64| {
            let azimuth_rad = azimuth_deg.to_radians();
            let ray = Ray { pixel: 0, ring: 0, azimuth_rad, elevation_rad: 0.0, phase: 0.0 };
            sector.blocks(&ray, &mut crate::dice::dice(1, crate::dice::Purpose::Defect(0), 0))
        };
        assert!(blocks(175.0) && blocks(-175.0));
        assert!(!blocks(165.0) && !blocks(-165.0) && !blocks(0.0));
    }
}
