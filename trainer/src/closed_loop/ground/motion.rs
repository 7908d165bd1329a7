//! How a sensor moved over the ground from one scan to the next, from the walls that both see.

use std::collections::HashMap;

use lidar::Sensor;
use nalgebra::{Matrix3, Vector3};

use crate::closed_loop::lay::{Kind, Lay};

/// Walls are looked up in squares of this edge, in m.
const SQUARE_M: f64 = 1.0;

/// Farthest wall that is used, in m.
const FARTHEST_M: f64 = 40.0;

/// Points of a scan that are matched.
const POINTS: usize = 3000;

/// Distances within which matches are sought, one after the other, in m.
const GATES_M: [f64; 12] = [1.0, 1.0, 1.0, 0.7, 0.5, 0.4, 0.3, 0.3, 0.2, 0.2, 0.2, 0.2];

/// Misfit of a wall that is taken for noise, in m.
const NOISE_M: f64 = 0.05;

/// Steps ahead that are tried where nothing is known of the speed, in m.
const FIRST_STEPS_M: [f64; 9] = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, -0.5, -1.0];

/// Least share of points that have to match.
const LEAST_MATCHED: f64 = 0.5;

/// A move over the ground: a turn to the left and a step, of the first frame from the second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion {
    pub(super) ahead_m: f64,
    pub(super) left_m: f64,
    pub(super) yaw_rad: f64,
}

/// A point of a wall and the wall's unit normal there, from above.
type Facing = ([f64; 2], [f64; 2]);

/// The upright surfaces of a scan, from above.
#[derive(Clone, Debug)]
pub(super) struct Walls {
    points: Vec<[f64; 2]>,
    /// Points with their unit normals, by the square that they are in.
    squares: HashMap<(i64, i64), Vec<Facing>>,
}

impl Motion {
    pub(super) fn apply(self, p: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        [self.ahead_m + cos * p[0] - sin * p[1], self.left_m + sin * p[0] + cos * p[1]]
    }

    /// This one, seen from whose end another follows.
    pub(super) fn then(self, next: Self) -> Self {
        let [ahead_m, left_m] = self.apply([next.ahead_m, next.left_m]);
        Self { ahead_m, left_m, yaw_rad: self.yaw_rad + next.yaw_rad }
    }

    pub(super) fn distance_m(self) -> f64 {
        self.ahead_m.hypot(self.left_m)
    }
}

impl Walls {
    pub(super) fn new(lays: &[Option<Lay>], columns: usize, sensor: &Sensor) -> Self {
        let wall = |(i, lay): (usize, &Option<Lay>)| {
            let lay = lay.filter(|l| l.kind == Kind::Upright && l.range_m < FARTHEST_M)?;
            let [x, y, _] = sensor.point_m(i / columns, i % columns, lay.range_m);
            let size = lay.plane[0].hypot(lay.plane[1]);
            Some(([x, y], [lay.plane[0] / size, lay.plane[1] / size]))
        };
        let all: Vec<Facing> = lays.iter().enumerate().filter_map(wall).collect();
        let points = all.iter().step_by(all.len().div_ceil(POINTS).max(1)).map(|(p, _)| *p).collect();
        let mut squares: HashMap<(i64, i64), Vec<_>> = HashMap::new();
        for one in all {
            squares.entry(square(one.0)).or_default().push(one);
        }
        Self { points, squares }
    }

    /// The nearest point within `gate_m`, and its normal.
    fn nearest(&self, p: [f64; 2], gate_m: f64) -> Option<Facing> {
        let (x, y) = square(p);
        let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (x + dx, y + dy)));
        let away = |q: &[f64; 2]| (q[0] - p[0]).hypot(q[1] - p[1]);
        around
            .filter_map(|s| self.squares.get(&s))
            .flatten()
            .map(|one| (away(&one.0), one))
            .filter(|(d, _)| *d < gate_m)
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, one)| *one)
    }
}

fn square(p: [f64; 2]) -> (i64, i64) {
    ((p[0] / SQUARE_M).floor() as i64, (p[1] / SQUARE_M).floor() as i64)
}

/// The motion from the first scan to the second, starting from the one before it; `None` if too few walls match.
///
/// Iterated closest points with point-to-line distances (Censi 2008) and Cauchy's weights.
pub(super) fn between(first: &Walls, second: &Walls, before: Option<Motion>) -> Option<Motion> {
    let starts: Vec<Motion> = match before {
        Some(motion) => vec![motion],
        None => FIRST_STEPS_M.iter().map(|ahead_m| Motion { ahead_m: *ahead_m, ..Motion::default() }).collect(),
    };
    let found = starts.into_iter().filter_map(|start| align(first, second, start));
    let (matched, motion) = found.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (matched > LEAST_MATCHED).then_some(motion)
}

/// The share of points that match within the noise in the end, and the motion.
fn align(first: &Walls, second: &Walls, start: Motion) -> Option<(f64, Motion)> {
    let mut motion = start;
    let mut matched = 0.0;
    for gate_m in GATES_M {
        let (mut products, mut sums) = (Matrix3::zeros(), Vector3::zeros());
        matched = 0.0;
        for p in &second.points {
            let q = motion.apply(*p);
            let Some((wall, normal)) = first.nearest(q, gate_m) else { continue };
            let e = (wall[0] - q[0]) * normal[0] + (wall[1] - q[1]) * normal[1];
            let turn = normal[1] * (q[0] - motion.ahead_m) - normal[0] * (q[1] - motion.left_m);
            let row = Vector3::new(normal[0], normal[1], turn);
            let w = 1.0 / (1.0 + (e / NOISE_M).powi(2));
            products += row * row.transpose() * w;
            sums += row * (e * w);
            matched += w;
        }
        let step = products.try_inverse()? * sums;
        motion.ahead_m += step[0];
        motion.left_m += step[1];
        motion.yaw_rad += step[2];
    }
    Some((matched / second.points.len() as f64, motion))
}
