//! The road's course: where a point along and beside it lies in the world.

use std::f32::consts::TAU;

use glam::{Affine3A, Quat, Vec2, Vec3, vec2};
use rand::RngExt;

use super::Dice;
use super::config::{StreetConfig, pick};

/// Distance between the course's tabulated points.
const STEP_M: f32 = 0.5;

/// The course of the road's middle and the lie of the land.
///
/// A place is named by `along` (metres from the sensor, ahead positive) and `left` (metres to the left of the road's middle).
#[derive(Clone, Debug)]
pub(super) struct Road {
    middle: Vec<Vec2>,
    heading_rad: Vec<f32>,
    reach_m: f32,
    /// Where the sensor is beside the road's middle.
    sensor_left_m: f32,
    land: Land,
}

/// Slope, waves and bumps.
#[derive(Clone, Debug)]
struct Land {
    slope: f32,
    cross_slope: f32,
    waves: [Wave; 3],
    roughness_m: f32,
    camber_half_m: f32,
    even_half_m: f32,
    seed: u32,
}

#[derive(Clone, Copy, Debug)]
struct Wave {
    per_m: Vec2,
    phase: f32,
    height_m: f32,
}

impl Road {
    /// `half_m` is how far to each side the camber goes, and how far the ground is even, as roads and pavements are.
    pub(super) fn new(config: &StreetConfig, half_m: [f32; 2], sensor_left_m: f32, dice: &mut Dice) -> Self {
        let bend = pick(config.curvature_per_m, dice) * if dice.random() { 1.0 } else { -1.0 };
        let (wavelength_m, phase) = (dice.random_range(180.0..500.0), dice.random_range(0.0..TAU));
        // Twenty metres more than anyone may ask for.
        let reach_m = config.reach_m + 20.0;
        let half = (reach_m / STEP_M) as usize + 1;
        let curvature = |along: f32| bend * (along * TAU / wavelength_m + phase).cos();
        let course = |sign: f32| {
            let (mut at, mut heading) = (Vec2::ZERO, 0.0f32);
            let mut points = vec![(at, heading)];
            for k in 0..half {
                let turn = sign * curvature(sign * (k as f32 + 0.5) * STEP_M) * STEP_M;
                at += Vec2::from_angle(heading + 0.5 * turn) * (sign * STEP_M);
                heading += turn;
                points.push((at, heading));
            }
            points
        };
        let mut points: Vec<(Vec2, f32)> = course(-1.0).into_iter().skip(1).rev().collect();
        points.extend(course(1.0));
        let slope = pick(config.slope, dice) * if dice.random() { 1.0 } else { -1.0 };
        let waves = std::array::from_fn(|_| Wave {
            per_m: Vec2::from_angle(dice.random_range(0.0..TAU)) * TAU / dice.random_range(25.0..90.0),
            phase: dice.random_range(0.0..TAU),
            height_m: dice.random_range(0.02..0.12),
        });
        Self {
            middle: points.iter().map(|p| p.0).collect(),
            heading_rad: points.iter().map(|p| p.1).collect(),
            reach_m: half as f32 * STEP_M,
            sensor_left_m,
            land: Land {
                slope,
                cross_slope: dice.random_range(-0.02..0.02),
                waves,
                roughness_m: pick(config.roughness_m, dice),
                camber_half_m: half_m[0],
                even_half_m: half_m[1],
                seed: dice.random(),
            },
        }
    }

    /// The place in the world, `up_m` above the road's profile there.
    pub(super) fn at(&self, along_m: f32, left_m: f32, up_m: f32) -> Vec3 {
        let flat = self.flat(along_m, left_m) - vec2(0.0, self.sensor_left_m);
        flat.extend(self.land.height_m(along_m, left_m) - self.land.height_m(0.0, self.sensor_left_m) + up_m)
    }

    /// A frame there with x along the road, turned by `turn_rad` to the left, and z straight up.
    pub(super) fn frame(&self, along_m: f32, left_m: f32, up_m: f32, turn_rad: f32) -> Affine3A {
        let heading = self.sample(along_m).1 + turn_rad;
        Affine3A::from_rotation_translation(Quat::from_rotation_z(heading), self.at(along_m, left_m, up_m))
    }

    /// A frame at the first place, with x towards the second, and how far that is; z is straight up.
    pub(super) fn frame_towards(&self, from: [f32; 2], to: [f32; 2], up_m: f32) -> (Affine3A, f32) {
        let way = self.flat(to[0], to[1]) - self.flat(from[0], from[1]);
        let at = self.at(from[0], from[1], up_m);
        (Affine3A::from_rotation_translation(Quat::from_rotation_z(way.to_angle()), at), way.length())
    }

    fn flat(&self, along_m: f32, left_m: f32) -> Vec2 {
        let (middle, heading) = self.sample(along_m);
        middle + Vec2::from_angle(heading).perp() * left_m
    }

    fn sample(&self, along_m: f32) -> (Vec2, f32) {
        let position = ((along_m + self.reach_m) / STEP_M).clamp(0.0, (self.middle.len() - 1) as f32);
        let k = (position as usize).min(self.middle.len() - 2);
        let part = position - k as f32;
        let heading = self.heading_rad[k] + part * (self.heading_rad[k + 1] - self.heading_rad[k]);
        (self.middle[k].lerp(self.middle[k + 1], part), heading)
    }
}

impl Land {
    fn height_m(&self, along_m: f32, left_m: f32) -> f32 {
        let beside = (left_m.abs() - self.camber_half_m).max(0.0);
        let off_road = ((left_m.abs() - self.even_half_m) / 5.0).clamp(0.0, 1.0);
        // 2 % camber lets the rain run off to both sides.
        let camber = -0.02 * left_m.abs().min(self.camber_half_m);
        let place = vec2(along_m, left_m);
        let waves: f32 = self.waves.iter().map(|w| w.height_m * (w.per_m.dot(place) + w.phase).sin()).sum();
        let road_bumps = 0.008 * self.noise(place / 2.7, 0);
        let bumps = off_road * self.roughness_m * (self.noise(place / 1.9, 1) + 2.0 * self.noise(place / 7.0, 2));
        let rise = self.cross_slope * left_m.signum() * beside;
        self.slope * along_m + camber + waves * (0.4 + 0.6 * off_road) + road_bumps + bumps + rise
    }

    /// Smooth noise from −1 to 1 with a period of about 1.
    fn noise(&self, place: Vec2, layer: u32) -> f32 {
        let cell = place.floor();
        let t = place - cell;
        let t = t * t * (Vec2::splat(3.0) - 2.0 * t);
        let corner = |dx: i32, dy: i32| hash(self.seed ^ layer, cell.x as i32 + dx, cell.y as i32 + dy);
        let near = corner(0, 0) + t.x * (corner(1, 0) - corner(0, 0));
        let far = corner(0, 1) + t.x * (corner(1, 1) - corner(0, 1));
        near + t.y * (far - near)
    }
}

/// A number from −1 to 1 that looks random, of a place on a grid (the finaliser of `MurmurHash3`).
pub(super) fn hash(seed: u32, x: i32, y: i32) -> f32 {
    let mut h = seed ^ (x as u32).wrapping_mul(0x9e37_79b9) ^ (y as u32).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^= h >> 16;
    (h >> 8) as f32 / (1u32 << 23) as f32 - 1.0
}
