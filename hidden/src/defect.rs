//! Any defect: what it is called, what is true about it, what it does to a ray.

use lidar::Sensor;
use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::dice::Dice;
use crate::geometry::Geometry;
use crate::measure::Return;
use crate::range::Range;
use crate::reflectance::Reflectance;
use crate::returns::Returns;
use crate::sweep::{Ray, Shot, Sweep};
use crate::unknown::Unknown;

/// What is wrong with a sensor. In files each group's variants are told by `defect = "their_name"`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Defect {
    /// The true ray is not where the sensor's description says.
    Geometry(Geometry),
    /// The right surface at the wrong distance.
    Range(Range),
    /// The right surface, too bright or too dark.
    Reflectance(Reflectance),
    /// Echoes that are not reported, and returns that are no echoes.
    Returns(Returns),
    /// What no library has a name for.
    Unknown(Unknown),
}

/// What a defect changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// Which surface a ray meets, and with it everything else.
    Geometry,
    /// The range of rays with a return.
    Range,
    /// The reflectance of rays with a return.
    Reflectance,
    /// Echoes without a return.
    Missing,
    /// Returns without an echo, in place of one or not.
    Extra,
}

/// Names of the defects that the effect library knows too.
pub const LIBRARY: &[&str] = &[
    "elevation_offset",
    "elevation_offset_per_ring",
    "azimuth_offset_per_ring",
    "encoder_eccentricity",
    "mount_roll",
    "mount_pitch",
    "mount_yaw",
    "mount_height",
    "rolling_shutter",
    "range_offset",
    "range_offset_per_ring",
    "range_scale",
    "range_walk",
    "range_noise",
    "incidence_stretch",
    "mixed_pixels",
    "quantisation",
    "ring_gain",
    "reflectance_falloff",
    "incidence_falloff",
    "saturation",
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

/// Names of the defects that it does not know.
pub const UNKNOWN: &[&str] = Unknown::NAMES;

/// Names with units and values; a parameter with one value a ring comes once a ring, ring 0 first.
pub(crate) type Truth = Vec<(&'static str, f64)>;

/// The defect of this name from [`LIBRARY`] or [`UNKNOWN`] at `size` times its typical magnitude (that of an HDL-64E), with a random
/// sign, phase, ring pattern or sector where it has one; `None` for any other name.
pub fn typical(name: &str, size: f64, sensor: &Sensor, rng: &mut impl Rng) -> Option<Defect> {
    (Geometry::typical(name, size, sensor, rng).map(Defect::Geometry))
        .or_else(|| Range::typical(name, size, sensor, rng).map(Defect::Range))
        .or_else(|| Reflectance::typical(name, size, sensor, rng).map(Defect::Reflectance))
        .or_else(|| Returns::typical(name, size, sensor, rng).map(Defect::Returns))
        .or_else(|| Unknown::typical(name, size, rng).map(Defect::Unknown))
}

impl Defect {
    /// The identifier of the library's effect that says the same; `None` where there is none.
    pub fn name(&self) -> Option<&'static str> {
        (!matches!(self, Self::Unknown(_))).then(|| self.title())
    }

    /// The defect's own name, from [`LIBRARY`] or [`UNKNOWN`].
    pub fn title(&self) -> &'static str {
        match self {
            Self::Geometry(defect) => defect.name(),
            Self::Range(defect) => defect.name(),
            Self::Reflectance(defect) => defect.name(),
            Self::Returns(defect) => defect.name(),
            Self::Unknown(defect) => defect.name(),
        }
    }

    /// The parameters' names, with units, and values. One with a value for each ring (or class) comes once for each, in their order.
    pub fn truth(&self) -> Vec<(&'static str, f64)> {
        match self {
            Self::Geometry(defect) => defect.truth(),
            Self::Range(defect) => defect.truth(),
            Self::Reflectance(defect) => defect.truth(),
            Self::Returns(defect) => defect.truth(),
            Self::Unknown(defect) => defect.truth(),
        }
    }

    /// What it changes; everything else stays as it was, but for echoes that an error of range moves across the sensor's limits.
    pub fn channels(&self) -> &'static [Channel] {
        match self {
            Self::Geometry(_) => &[Channel::Geometry],
            Self::Range(_) => &[Channel::Range],
            Self::Reflectance(_) => &[Channel::Reflectance],
            Self::Returns(defect) => defect.channels(),
            Self::Unknown(defect) => std::slice::from_ref(defect.channel_ref()),
        }
    }

    /// What it adds to the range of a ray.
    pub(crate) fn range_error_m(&self, shot: &Shot, dice: &mut Dice) -> f64 {
        match self {
            Self::Range(defect) => defect.error_m(shot, dice),
            Self::Returns(defect) => defect.error_m(shot),
            Self::Unknown(defect) => defect.error_m(shot),
            Self::Geometry(_) | Self::Reflectance(_) => 0.0,
        }
    }

    /// The share of the light that is left.
    pub(crate) fn light_factor(&self, shot: &Shot) -> f64 {
        match self {
            Self::Reflectance(defect) => defect.factor(shot),
            Self::Returns(defect) => defect.factor(shot),
            Self::Unknown(defect) => defect.factor(&shot.ray),
            Self::Geometry(_) | Self::Range(_) => 1.0,
        }
    }

    /// What a ring's electronics make of a reflectance.
    pub(crate) fn amplified(&self, ring: usize, reflectance: f64) -> f64 {
        if let Self::Reflectance(defect) = self { defect.amplified(ring, reflectance) } else { reflectance }
    }

    /// Whether the echo of a ray is lost.
    pub(crate) fn loses(&self, shot: &Shot, dice: &mut Dice) -> bool {
        match self {
            Self::Returns(defect) => defect.loses(shot, dice),
            Self::Unknown(defect) => defect.loses(shot, dice),
            Self::Geometry(_) | Self::Range(_) | Self::Reflectance(_) => false,
        }
    }

    /// Returns that are no echoes of what their rays aim at, by pixel.
    pub(crate) fn ghosts(&self, sweep: &Sweep, dice: &mut Dice) -> Vec<(usize, Return)> {
        if let Self::Returns(defect) = self { defect.ghosts(sweep, dice) } else { Vec::new() }
    }

    /// Whether something on the sensor itself is in a ray's way.
    pub(crate) fn blocks(&self, ray: &Ray, dice: &mut Dice) -> bool {
        if let Self::Returns(defect) = self { defect.blocks(ray, dice) } else { false }
    }
}

macro_rules! defect_from {
    ($($group:ident),*) => { $(impl From<$group> for Defect {
        fn from(defect: $group) -> Self { Self::$group(defect) }
    })* };
}
defect_from!(Geometry, Range, Reflectance, Returns, Unknown);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dice::{Purpose, dice};
    use crate::small_sensor;

    #[test]
    fn the_library_is_all_the_groups_but_the_unknown() {
        let groups = [Geometry::NAMES, Range::NAMES, Reflectance::NAMES, Returns::NAMES].concat();
        assert_eq!(LIBRARY, groups);
        assert!(UNKNOWN.iter().all(|name| !LIBRARY.contains(name)));
    }

    #[test]
    fn every_name_makes_the_defect_of_that_name_and_its_file_says_so() -> Result<(), Box<dyn std::error::Error>> {
        let sensor = small_sensor(1);
        for name in LIBRARY.iter().chain(UNKNOWN) {
            let defect = typical(name, 1.0, &sensor, &mut dice(3, Purpose::Scene, 0)).ok_or(*name)?;
            assert_eq!(defect.title(), *name);
            assert_eq!(defect.name().is_some(), LIBRARY.contains(name), "{name}");
            assert!(defect.truth().iter().all(|(_, value)| value.is_finite()), "{name}");
            let file = toml::to_string(&defect)?;
            assert!(file.contains(&format!("defect = \"{name}\"")), "{file}");
            assert_eq!(toml::from_str::<Defect>(&file)?, defect);
        }
        assert_eq!(typical("gremlins", 1.0, &sensor, &mut dice(3, Purpose::Scene, 0)), None);
        Ok(())
    }
}
