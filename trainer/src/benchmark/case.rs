//! One set of the benchmark: what is asked, and the recipe that it is made by.

use hidden::{Defect, Noise, Recipe, even_sensor, small_sensor, typical};
use lidar::Sensor;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::suite::Suite;

/// One set of a suite.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// The question.
    pub suite: Suite,
    /// Names of the defects.
    pub names: Vec<String>,
    /// Their size, 1 being typical.
    pub size: f64,
    /// Which of the sets that ask the same.
    pub number: u64,
}

/// How large the sets are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// Two frames in each of ten streets; sensors of 16–32 rings and 256–512 columns.
    Full,
    /// One frame in each of six streets; 16 rings and 256 columns.
    Small,
    /// Two frames in each of so many streets, of so many rings and columns.
    Grid {
        /// Rings.
        rings: usize,
        /// Columns.
        columns: usize,
        /// Streets.
        scenes: usize,
    },
}

impl Case {
    /// The seed of everything in it; sets that differ in nothing but size share it.
    pub fn seed(&self) -> u64 {
        let digest = Sha256::digest(format!("{}/{}/{}", self.suite.name(), self.names.join("+"), self.number));
        digest.iter().take(8).fold(0, |seed, byte| seed << 8 | u64::from(*byte))
    }

    /// What it is called in tables.
    pub fn label(&self) -> String {
        if self.names.is_empty() { "nothing".into() } else { self.names.join(" + ") }
    }

    /// The recipe of its set.
    ///
    /// # Panics
    /// If one of its names is no defect's, or no sensor has the grid of its extent.
    pub fn recipe(&self, extent: Extent) -> Recipe {
        let seed = self.seed();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let noise = Noise::varied(&mut rng);
        let sensor = extent.sensor(seed);
        let hide = |name: &String| -> Defect {
            typical(name, self.size, &sensor, &mut rng).unwrap_or_else(|| panic!("{name:?} is no defect"))
        };
        let hidden = self.names.iter().map(hide).collect();
        let recipe = Recipe { noise, ..Recipe::new(seed, sensor, hidden) };
        match extent {
            Extent::Full => recipe,
            Extent::Small => Recipe { scenes: 6, frames_per_scene: 1, ..recipe },
            Extent::Grid { scenes, .. } => Recipe { scenes, ..recipe },
        }
    }
}

impl Extent {
    fn sensor(self, seed: u64) -> Sensor {
        if let Self::Grid { rings, columns, .. } = self {
            return even_sensor(rings, columns).unwrap_or_else(|error| panic!("{rings} × {columns}: {error}"));
        }
        let fits = |sensor: &Sensor| self == Self::Full || (sensor.rings().len(), sensor.columns()) == (16, 256);
        let mut sensors = (0..).map(|k: u64| small_sensor(seed.wrapping_add(k)));
        sensors.find(fits).unwrap_or_else(|| unreachable!("a sixth of all seeds fit"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_larger_size_is_the_same_set_with_more_of_the_defect() {
        let case = |size| Case { suite: Suite::Size, names: vec!["range_walk".into()], size, number: 3 };
        let [small, large] = [0.5, 1.0].map(|size| case(size).recipe(Extent::Small));
        assert_eq!((small.seed, &small.sensor, small.noise), (large.seed, &large.sensor, large.noise));
        let amplitude_m = |recipe: &Recipe| recipe.hidden[0].truth()[0].1;
        assert_eq!(2.0 * amplitude_m(&small), amplitude_m(&large));
    }
}
