//! Whether rays point higher or lower than the description says, from measured scans alone: the ground tells.
//!
//! A ray that points δ higher than it is said to makes a return at distance d seem lower by δ·d: level ground seems to be a cone, equally
//! in all directions, while a leaning mount tilts it. A single scan cannot tell a cone from ground that is domed by its crown or by the
//! road's own bends ([`GroundReport::single`], [`GroundReport::single_on_curved_ground`]). Two scans a few metres apart can: where they
//! see the same piece of ground, whatever its shape, from distances d₁ and d₂, its heights differ by δ·(d₂ − d₁), and by the plane that
//! the sensor's height and lean between the scans make.
//!
//! What lengthens ranges in proportion to r·tan α (incidence stretch) does the same to ground, and is not told apart.

mod fit;
mod motion;
mod patches;
#[cfg(test)]
mod tests;

use lidar::{RangeImage, Sensor};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use self::fit::robust;
use self::motion::{Motion, Walls, between};
use self::patches::{Patches, ground_points};
use super::lay::lays;

/// Two scans are compared once the sensor has moved so far, in m: from nearer places the same ground is seen at too nearly the same
/// distances, and the noise of its heights is all that is left.
const BASELINE_M: f64 = 3.0;

/// Scans farther apart than this see too little of the same ground.
const FARTHEST_M: f64 = 12.0;

/// Half a 95 % interval, in standard errors.
const HALF: f64 = 1.96;

/// Fewer patches tell nothing.
const LEAST_PATCHES: usize = 100;

/// Misfit of ground that is robustly taken for noise, in m.
const NOISE_M: f64 = 0.02;

/// By how much rays point higher than the description says, over all scans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elevation {
    /// The angle in degrees.
    pub offset_deg: f64,
    /// Its standard error, from a bootstrap over scenes.
    pub stderr_deg: f64,
    /// Scans, or pairs of scans, that told.
    pub told: usize,
}

/// What the ground tells; `None` where it tells nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundReport {
    /// From each scan alone, if ground were a plane.
    pub single: Option<Elevation>,
    /// From each scan alone, if it may be curved as well.
    pub single_on_curved_ground: Option<Elevation>,
    /// From scans of the same ground.
    pub registered: Option<Elevation>,
}

/// One scan's or pair's estimate.
#[derive(Clone, Copy, Debug)]
struct Told {
    scene: usize,
    offset_rad: f64,
    weight: f64,
}

/// Measures on scans in the order in which they were taken, each with the number of its scene.
pub fn measure(scans: &[(usize, &RangeImage)], sensor: &Sensor) -> GroundReport {
    let seen: Vec<(Walls, Vec<[f64; 3]>)> = scans
        .par_iter()
        .map(|(_, image)| {
            let lays = lays(image, sensor);
            (Walls::new(&lays, image.columns(), sensor), ground_points(&lays, image.columns(), sensor))
        })
        .collect();
    let alone = |curved: bool| {
        let told = scans.iter().zip(&seen).filter_map(|((scene, _), (_, ground))| single(*scene, ground, curved));
        combine(&told.collect::<Vec<_>>())
    };
    let (single, single_on_curved_ground) = (alone(false), alone(true));
    let steps = steps(&seen);
    let told: Vec<Told> = (0..scans.len())
        .into_par_iter()
        .filter_map(|i| {
            let mut motion = Motion::default();
            for (j, step) in steps.iter().enumerate().skip(i) {
                motion = motion.then((*step)?);
                let moved_m = motion.distance_m();
                if moved_m > FARTHEST_M {
                    return None;
                }
                if moved_m >= BASELINE_M {
                    return twice(scans[i].0, &seen[i].1, &seen[j + 1].1, motion);
                }
            }
            None
        })
        .collect();
    GroundReport { single, single_on_curved_ground, registered: combine(&told) }
}

/// The motion from each scan to the next, as far as walls tell.
fn steps(seen: &[(Walls, Vec<[f64; 3]>)]) -> Vec<Option<Motion>> {
    let mut last = None;
    seen.windows(2)
        .map(|pair| {
            last = between(&pair[0].0, &pair[1].0, last);
            last
        })
        .collect()
}

/// The cone that one scan's ground is, beside a plane, or beside a curved surface.
fn single(scene: usize, ground: &[[f64; 3]], curved: bool) -> Option<Told> {
    let patches = Patches::new(ground, Motion::default());
    let all = patches.all();
    if all.len() < LEAST_PATCHES {
        return None;
    }
    let heights: Vec<f64> = all.iter().map(|p| p.height_m).collect();
    let (slope, error) = if curved {
        let rows: Vec<[f64; 7]> = all
            .iter()
            .map(|p| [p.distance_m, 1.0, p.x_m, p.y_m, p.x_m * p.x_m, p.y_m * p.y_m, p.x_m * p.y_m])
            .collect();
        robust(&rows, &heights, 2.5 * NOISE_M)?
    } else {
        let rows: Vec<[f64; 4]> = all.iter().map(|p| [p.distance_m, 1.0, p.x_m, p.y_m]).collect();
        robust(&rows, &heights, 2.5 * NOISE_M)?
    };
    Some(Told { scene, offset_rad: -slope, weight: error.powi(-2) })
}

/// What one piece of ground seen from two places tells.
fn twice(scene: usize, first: &[[f64; 3]], second: &[[f64; 3]], first_from_second: Motion) -> Option<Told> {
    let both = Patches::new(first, Motion::default()).shared(&Patches::new(second, first_from_second));
    if both.len() < LEAST_PATCHES {
        return None;
    }
    let rows: Vec<[f64; 4]> = both.iter().map(|(a, b)| [a.distance_m - b.distance_m, 1.0, a.x_m, a.y_m]).collect();
    let heights: Vec<f64> = both.iter().map(|(a, b)| a.height_m - b.height_m).collect();
    let (slope, error) = robust(&rows, &heights, NOISE_M)?;
    Some(Told { scene, offset_rad: -slope, weight: error.powi(-2) })
}

/// Weighted mean, its standard error from a bootstrap over scenes (over estimates where there are fewer than three scenes).
fn combine(told: &[Told]) -> Option<Elevation> {
    let mean = |some: &[&Told]| {
        let weight: f64 = some.iter().map(|t| t.weight).sum();
        some.iter().map(|t| t.weight * t.offset_rad).sum::<f64>() / weight
    };
    if told.len() < 2 {
        return None;
    }
    let mut scenes: Vec<usize> = told.iter().map(|t| t.scene).collect();
    scenes.dedup();
    let blocks: Vec<Vec<&Told>> = if scenes.len() < 3 {
        told.iter().map(|t| vec![t]).collect()
    } else {
        told.chunk_by(|a, b| a.scene == b.scene).map(|c| c.iter().collect()).collect()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let means: Vec<f64> = (0..500)
        .map(|_| {
            let drawn: Vec<&Told> =
                (0..blocks.len()).flat_map(|_| blocks[rng.random_range(0..blocks.len())].clone()).collect();
            mean(&drawn)
        })
        .collect();
    let centre = means.iter().sum::<f64>() / means.len() as f64;
    let variance = means.iter().map(|m| (m - centre).powi(2)).sum::<f64>() / (means.len() - 1) as f64;
    let offset_deg = mean(&told.iter().collect::<Vec<_>>()).to_degrees();
    Some(Elevation { offset_deg, stderr_deg: variance.sqrt().to_degrees(), told: told.len() })
}

impl GroundReport {
    /// What was found and what it is worth, in plain words, with 95 % intervals.
    pub fn sentences(&self) -> Vec<String> {
        let number = |e: &Elevation| format!("{:+.3}° ± {:.3}°", e.offset_deg, HALF * e.stderr_deg);
        let mut out = Vec::new();
        if let (Some(flat), Some(curved)) = (&self.single, &self.single_on_curved_ground) {
            out.push(format!(
                "single scans: rays point {} higher than described if ground is a plane, {} if it may be curved ({} scans); the \
                 difference between the two is what single scans cannot tell",
                number(flat),
                number(curved),
                flat.told
            ));
        }
        out.push(match &self.registered {
            Some(e) => format!(
                "ground seen twice, from places {BASELINE_M} m or more apart: rays point {} higher than described ({} pairs of scans), or \
                 ranges grow with r·tan α as much as that would make the ground sink",
                number(e),
                e.told
            ),
            None => "no ground was seen from two places: registered scans say nothing about elevation".into(),
        });
        out
    }
}
