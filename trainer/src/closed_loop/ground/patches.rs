//! The ground in patches of half a metre.

use std::collections::BTreeMap;

use lidar::Sensor;

use super::motion::Motion;
use crate::closed_loop::lay::{Kind, Lay, ground_m};

/// Edge of a patch in m.
const PATCH_M: f64 = 0.5;

/// Returns nearer and farther than this are no good ground, in m.
const NEAREST_M: f64 = 3.5;
const FARTHEST_M: f64 = 30.0;

/// Ground is within this height of the median, in m.
const HEIGHT_M: f64 = 0.5;

/// A patch is flat if its returns differ in height by less than this, as standard deviation, in m.
const FLAT_M: f64 = 0.04;

/// A piece of ground as one scan sees it.
#[derive(Clone, Copy, Debug, Default)]
#[expect(clippy::struct_field_names, reason = "the unit is part of a length's name")]
pub(super) struct Patch {
    pub(super) height_m: f64,
    /// Horizontal distance from the sensor.
    pub(super) distance_m: f64,
    pub(super) x_m: f64,
    pub(super) y_m: f64,
}

/// Patches by where they are in a frame that scans share.
#[derive(Clone, Debug)]
pub(super) struct Patches(BTreeMap<(i64, i64), Patch>);

/// Returns of the ground, in the sensor's frame.
pub(super) fn ground_points(lays: &[Option<Lay>], columns: usize, sensor: &Sensor) -> Vec<[f64; 3]> {
    let ground_m = ground_m(lays);
    let point = |(i, lay): (usize, &Option<Lay>)| {
        let lay = lay.filter(|l| l.kind == Kind::Level)?;
        let p = sensor.point_m(i / columns, i % columns, lay.range_m);
        let distance_m = p[0].hypot(p[1]);
        let is_ground = (p[2] - ground_m).abs() < HEIGHT_M && (NEAREST_M..FARTHEST_M).contains(&distance_m);
        is_ground.then_some(p)
    };
    lays.iter().enumerate().filter_map(point).collect()
}

impl Patches {
    /// From returns, their places moved into the shared frame.
    pub(super) fn new(points: &[[f64; 3]], shared_from_sensor: Motion) -> Self {
        let mut sums: BTreeMap<(i64, i64), (f64, f64, Patch)> = BTreeMap::new();
        for p in points {
            let [x, y] = shared_from_sensor.apply([p[0], p[1]]);
            let at = ((x / PATCH_M).floor() as i64, (y / PATCH_M).floor() as i64);
            let (n, squares, patch) = sums.entry(at).or_default();
            *n += 1.0;
            *squares += p[2] * p[2];
            patch.height_m += p[2];
            patch.distance_m += p[0].hypot(p[1]);
            patch.x_m += x;
            patch.y_m += y;
        }
        let mean = |(at, (n, squares, sum)): ((i64, i64), (f64, f64, Patch))| {
            let patch = Patch {
                height_m: sum.height_m / n,
                distance_m: sum.distance_m / n,
                x_m: sum.x_m / n,
                y_m: sum.y_m / n,
            };
            let variance = squares / n - patch.height_m.powi(2);
            (n >= 2.0 && variance < FLAT_M * FLAT_M).then_some((at, patch))
        };
        Self(sums.into_iter().filter_map(mean).collect())
    }

    /// All patches.
    pub(super) fn all(&self) -> Vec<Patch> {
        self.0.values().copied().collect()
    }

    /// The patches that both have.
    pub(super) fn shared(&self, other: &Self) -> Vec<(Patch, Patch)> {
        self.0.iter().filter_map(|(at, a)| other.0.get(at).map(|b| (*a, *b))).collect()
    }
}
