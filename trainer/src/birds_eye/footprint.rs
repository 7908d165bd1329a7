//! Rectangles on the ground.

use std::f32::consts::{FRAC_PI_2, PI};

use lidar::birds_eye::{Grid, Outline};
use serde::Serialize;

/// Directions that a rectangle is tried in, over a right angle.
const DIRECTIONS: usize = 90;

/// Distances from an edge below this one count alike, in metres: what a sensor's ranges scatter by.
const CLOSE_M: f32 = 0.05;

/// What of a vehicle was seen, from above: a rectangle in the sensor's frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Footprint {
    /// Ahead and left of the sensor, in metres.
    pub center_m: [f32; 2],
    /// The longer side, in metres.
    pub length_m: f32,
    /// The shorter one.
    pub width_m: f32,
    /// Direction of the longer side, counter-clockwise from ahead, −π/2 to π/2: front and back are not told apart.
    pub yaw_rad: f32,
}

impl Footprint {
    /// A rectangle of these sides, of which the first has this direction.
    pub fn new(center_m: [f32; 2], sides_m: [f32; 2], direction_rad: f32) -> Self {
        let [along, across] = sides_m;
        let (length_m, width_m, yaw) =
            if along >= across { (along, across, direction_rad) } else { (across, along, direction_rad + FRAC_PI_2) };
        Self { center_m, length_m, width_m, yaw_rad: (yaw + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2 }
    }

    /// The rectangle around points, at least one, whose edges most points are close to: a lidar sees two sides of a vehicle, so the smallest
    /// rectangle may stand aslant. Zhang et al., "Efficient L-shape fitting for vehicle detection using laser scanners" (IV 2017), closeness.
    pub fn around(points: &[[f32; 2]]) -> Self {
        let tried = (0..DIRECTIONS).map(|k| {
            let direction = FRAC_PI_2 * k as f32 / DIRECTIONS as f32;
            let [along, across] = [direction, direction + FRAC_PI_2].map(|d| Extent::of(points, d));
            let closeness: f32 =
                points.iter().map(|p| along.off_edge(*p).min(across.off_edge(*p)).max(CLOSE_M).recip()).sum();
            (closeness, direction, along, across)
        });
        let (_, direction, along, across) =
            tried.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_else(|| unreachable!("there are directions"));
        let (sin, cos) = direction.sin_cos();
        let [u, v] = [along.middle(), across.middle()];
        Self::new([u * cos - v * sin, u * sin + v * cos], [along.length(), across.length()], direction)
    }

    /// Its corners, counter-clockwise.
    pub fn corners(&self) -> [[f32; 2]; 4] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        [[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]].map(|[u, v]| {
            let (u, v) = (u * self.length_m, v * self.width_m);
            [self.center_m[0] + u * cos - v * sin, self.center_m[1] + u * sin + v * cos]
        })
    }

    /// Its corners in a picture of a grid.
    pub fn outline(&self, grid: &Grid) -> Outline {
        self.corners().map(|corner| grid.place(corner))
    }

    /// Distance of two centres, in metres.
    pub fn distance_m(&self, other: &Self) -> f32 {
        (self.center_m[0] - other.center_m[0]).hypot(self.center_m[1] - other.center_m[1])
    }

    /// Whether a place lies within it.
    pub fn holds(&self, place_m: [f32; 2]) -> bool {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let [x, y] = [place_m[0] - self.center_m[0], place_m[1] - self.center_m[1]];
        (x * cos + y * sin).abs() <= self.length_m / 2.0 && (y * cos - x * sin).abs() <= self.width_m / 2.0
    }

    /// The area that two have in common, as a share of what they cover together.
    pub fn overlap(&self, other: &Self) -> f32 {
        let common = area(&common(&self.corners(), &other.corners()));
        let together = self.length_m * self.width_m + other.length_m * other.width_m - common;
        if together > 0.0 { common / together } else { 0.0 }
    }

    /// The same, turned about the sensor, and mirrored at its x axis before, if it is to be.
    #[must_use]
    pub fn turned(&self, yaw_rad: f32, mirrored: bool) -> Self {
        let side = if mirrored { -1.0 } else { 1.0 };
        let (sin, cos) = yaw_rad.sin_cos();
        let [x, y] = [self.center_m[0], side * self.center_m[1]];
        let center_m = [x * cos - y * sin, x * sin + y * cos];
        Self::new(center_m, [self.length_m, self.width_m], side * self.yaw_rad + yaw_rad)
    }
}

/// How far points reach in a direction.
#[derive(Clone, Copy)]
struct Extent {
    unit: [f32; 2],
    from: f32,
    to: f32,
}

impl Extent {
    fn of(points: &[[f32; 2]], direction_rad: f32) -> Self {
        let (sin, cos) = direction_rad.sin_cos();
        let empty = Self { unit: [cos, sin], from: f32::INFINITY, to: f32::NEG_INFINITY };
        points.iter().fold(empty, |extent, point| {
            let at = extent.at(*point);
            Self { from: extent.from.min(at), to: extent.to.max(at), ..extent }
        })
    }

    fn at(&self, point: [f32; 2]) -> f32 {
        self.unit[0] * point[0] + self.unit[1] * point[1]
    }

    fn off_edge(&self, point: [f32; 2]) -> f32 {
        let at = self.at(point);
        (at - self.from).min(self.to - at)
    }

    fn middle(&self) -> f32 {
        f32::midpoint(self.from, self.to)
    }

    fn length(&self) -> f32 {
        self.to - self.from
    }
}

/// What two convex polygons have in common, corners counter-clockwise: Sutherland and Hodgman, "Reentrant polygon clipping" (1974).
fn common(polygon: &[[f32; 2]], window: &[[f32; 2]; 4]) -> Vec<[f32; 2]> {
    let mut left = polygon.to_vec();
    for (a, b) in window.iter().zip(window.iter().cycle().skip(1)) {
        let inside = |p: &[f32; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
        let mut kept = Vec::with_capacity(left.len() + 1);
        for (p, q) in left.iter().zip(left.iter().cycle().skip(1)) {
            let (at_p, at_q) = (inside(p), inside(q));
            if at_p >= 0.0 {
                kept.push(*p);
            }
            if (at_p >= 0.0) != (at_q >= 0.0) {
                let part = at_p / (at_p - at_q);
                kept.push([p[0] + part * (q[0] - p[0]), p[1] + part * (q[1] - p[1])]);
            }
        }
        left = kept;
    }
    left
}

/// Area of a polygon, corners counter-clockwise.
fn area(polygon: &[[f32; 2]]) -> f32 {
    let crossed = polygon.iter().zip(polygon.iter().cycle().skip(1)).map(|(p, q)| p[0] * q[1] - q[0] * p[1]);
    crossed.sum::<f32>() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f32, y: f32, yaw_rad: f32) -> Footprint {
        Footprint::new([x, y], [1.0, 1.0], yaw_rad)
    }

    #[test]
    fn overlaps_are_those_of_geometry() {
        let unit = square(3.0, -2.0, 0.0);
        for (other, expected) in [
            (unit, 1.0),
            (square(3.5, -2.0, 0.0), 1.0 / 3.0),
            (square(3.5, -1.5, 0.0), 1.0 / 7.0),
            // A square and the same turned by 45°: an octagon of area 2(√2 − 1).
            (square(3.0, -2.0, PI / 4.0), 0.5f32.sqrt()),
            (square(5.0, -2.0, 0.3), 0.0),
            (Footprint::new([3.0, -2.0], [0.5, 0.5], 0.7), 0.25),
            (Footprint::new([3.0, -2.0], [1.0, 0.0], 0.7), 0.0),
        ] {
            assert!((unit.overlap(&other) - expected).abs() < 1e-5, "{other:?}: {}", unit.overlap(&other));
            assert!((other.overlap(&unit) - expected).abs() < 1e-5, "{other:?}: {}", other.overlap(&unit));
        }
        assert!(unit.holds([3.4, -2.4]) && !unit.holds([3.6, -2.0]));
        assert!(square(0.0, 0.0, PI / 4.0).holds([0.7, 0.0]) && !square(0.0, 0.0, 0.0).holds([0.7, 0.0]));
    }

    #[test]
    fn two_sides_of_a_vehicle_are_enough_for_its_rectangle() {
        for degrees in [-80.0f32, -30.0, 0.0, 10.0, 45.0, 89.0] {
            let truth = Footprint::new([8.0, 5.0], [4.0, 1.8], degrees.to_radians());
            let [a, b, c, _] = truth.corners();
            let side = |from: [f32; 2], to: [f32; 2]| {
                (0..40).map(move |i| [0, 1].map(|k| from[k] + (to[k] - from[k]) * i as f32 / 39.0))
            };
            let found = Footprint::around(&side(a, b).chain(side(b, c)).collect::<Vec<_>>());
            assert!(found.overlap(&truth) > 0.95, "{degrees}: {found:?} {truth:?}");
        }
        let point = Footprint::around(&[[1.0, 2.0]]);
        assert!((point.center_m[0] - 1.0).abs() < 1e-6 && point.length_m == 0.0, "{point:?}");
    }

    #[test]
    fn a_turn_moves_corners_as_it_moves_points() {
        let before = Footprint::new([6.0, 2.0], [4.0, 1.5], 0.4);
        for (yaw, mirrored) in [(0.7f32, false), (-2.5, true), (3.0, false)] {
            let after = before.turned(yaw, mirrored);
            let (sin, cos) = yaw.sin_cos();
            for [x, y] in before.corners() {
                let y = if mirrored { -y } else { y };
                let moved = [x * cos - y * sin, x * sin + y * cos];
                let nearest =
                    after.corners().map(|c| (c[0] - moved[0]).hypot(c[1] - moved[1])).into_iter().fold(9.0, f32::min);
                assert!(nearest < 1e-5, "{yaw} {mirrored}: {nearest}");
            }
        }
    }
}
