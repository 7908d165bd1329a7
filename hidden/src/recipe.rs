//! A recipe: everything that a paired set is made from.

use lidar::{RangeImage, Sensor};
use rand::{Rng, RngExt};
use rayon::prelude::*;
use scene::street::{StreetConfig, street};
use scene::{Pose, Scene};
use serde::{Deserialize, Serialize};

use crate::defect::Defect;
use crate::dice::{Purpose, dice};
use crate::drive::poses;
use crate::geometry::Aim;
use crate::measure::measure;
use crate::sweep::Sweep;

/// How far a drive of a few frames goes from the middle of its street.
const DRIVE_M: f32 = 15.0;

/// Everything that a paired set is made from: the same recipe always gives the same set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Of streets, poses and noise.
    pub seed: u64,
    /// The sensor as it is described.
    pub sensor: Sensor,
    /// Number of streets.
    pub scenes: usize,
    /// Frames in each of them.
    pub frames_per_scene: usize,
    /// What the sensor does besides its defects, and what everyone knows about it.
    pub noise: Noise,
    /// What nobody knows.
    #[serde(default)]
    pub hidden: Vec<Defect>,
}

/// What every sensor does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Noise {
    /// Standard deviation of ranges.
    pub range_sigma_m: f64,
    /// Standard deviation of reflectances, before they are cut to 0–1.
    pub reflectance_sigma: f64,
    /// Share of the returns that is lost for no reason.
    pub drop: f64,
}

/// One scan, simulated and measured from the same pose of the same street.
#[derive(Clone, Debug, PartialEq)]
pub struct HiddenFrame {
    /// Number of the street, from 0.
    pub scene: usize,
    /// What an ideal sensor, as described, would report; with classes.
    pub simulated: RangeImage,
    /// What the defective one reports, on the same grid; without classes.
    pub measured: RangeImage,
}

impl Default for Noise {
    /// 2 cm, 0.02 and 5 %.
    fn default() -> Self {
        Self { range_sigma_m: 0.02, reflectance_sigma: 0.02, drop: 0.05 }
    }
}

impl Noise {
    /// A draw of what good and bad sensors do: 1–3 cm, 0.01–0.03, 2–10 %.
    pub fn varied(rng: &mut impl Rng) -> Self {
        Self {
            range_sigma_m: rng.random_range(0.01..0.03),
            reflectance_sigma: rng.random_range(0.01..0.03),
            drop: rng.random_range(0.02..0.1),
        }
    }
}

impl Recipe {
    /// Two frames in each of ten streets, with the default noise.
    pub fn new(seed: u64, sensor: Sensor, hidden: Vec<Defect>) -> Self {
        Self { seed, sensor, scenes: 10, frames_per_scene: 2, noise: Noise::default(), hidden }
    }
}

/// Makes the frames, scene by scene.
pub fn frames(recipe: &Recipe) -> Vec<HiddenFrame> {
    // A street's triangles are most of the work: none beyond what the sensor sees.
    let config = StreetConfig { reach_m: recipe.sensor.range_limits_m().1 + DRIVE_M, ..StreetConfig::default() };
    let of_scene = |scene: usize| {
        let mut dice = dice(recipe.seed, Purpose::Scene, scene);
        let street = street(dice.random(), &config);
        let poses = poses(&street, recipe.frames_per_scene, &mut dice);
        let first = scene * recipe.frames_per_scene;
        let made = poses.par_iter().enumerate().map(|(k, pose)| frame(recipe, &street, pose, first + k));
        made.map(|(simulated, measured)| HiddenFrame { scene, simulated, measured }).collect::<Vec<_>>()
    };
    (0..recipe.scenes).into_par_iter().flat_map(of_scene).collect()
}

/// The simulated and the measured half of frame `number` of a recipe, in any scene and from any pose.
pub fn frame(recipe: &Recipe, street: &Scene, pose: &Pose, number: usize) -> (RangeImage, RangeImage) {
    let geometry = recipe.hidden.iter().filter_map(|defect| match defect {
        Defect::Geometry(geometry) => Some(geometry),
        _ => None,
    });
    let mut geometry = geometry.peekable();
    let described = Sweep::cast(street, &recipe.sensor, pose, &Aim::default(), number);
    let measured = if geometry.peek().is_none() {
        measure(&described, recipe)
    } else {
        measure(&Sweep::cast(street, &recipe.sensor, pose, &Aim::new(geometry), number), recipe)
    };
    (described.image(), measured)
}
