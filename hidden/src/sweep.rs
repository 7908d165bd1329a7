//! A sweep: what the rays of one turn met.

use glam::{DMat3, DVec3};
use lidar::label::class_of;
use lidar::{RangeImage, Sensor};
use scene::{Pose, Scene};

use crate::geometry::Aim;

/// What one ray met.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Echo {
    /// Distance from the sensor's origin at the moment of the shot.
    pub(crate) range_m: f64,
    /// Angle between the ray and the surface's normal.
    pub(crate) incidence_rad: f64,
    /// Reflectance of the surface, 0–1.
    pub(crate) reflectance: f64,
    /// Class of the learning map.
    pub(crate) class: u8,
}

/// A pixel of the sensor's grid, and where its ray looks by the sensor's description.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub(crate) pixel: usize,
    pub(crate) ring: usize,
    /// 0 is ahead, positive to the left.
    pub(crate) azimuth_rad: f64,
    pub(crate) elevation_rad: f64,
    /// Share of the turn that is over when the ray is sent, 0–1.
    pub(crate) phase: f64,
}

/// A ray that met something.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shot<'a> {
    pub(crate) sweep: &'a Sweep<'a>,
    pub(crate) ray: Ray,
    pub(crate) echo: Echo,
}

/// What the rays of one turn met, `[ring, column]`.
#[derive(Clone, Debug)]
pub(crate) struct Sweep<'a> {
    pub(crate) sensor: &'a Sensor,
    /// Number of the frame in its set, from 0.
    pub(crate) frame: usize,
    echoes: Vec<Option<Echo>>,
}

impl<'a> Sweep<'a> {
    /// Casts the rays of a sensor with this aim. What is nearer or farther than the sensor sees gives no echo.
    pub(crate) fn cast(scene: &Scene, sensor: &'a Sensor, pose: &Pose, aim: &Aim, frame: usize) -> Self {
        let place = DVec3::from_array(pose.position_m.map(f64::from));
        let turn = DMat3::from_rotation_z(f64::from(pose.yaw_rad))
            * DMat3::from_rotation_y(f64::from(pose.pitch_rad))
            * DMat3::from_rotation_x(f64::from(pose.roll_rad));
        let (nearest_m, farthest_m) = sensor.range_limits_m();
        let limits_m = f64::from(nearest_m)..=f64::from(farthest_m);
        let mut sweep = Self { sensor, frame, echoes: Vec::new() };
        sweep.echoes = (0..sensor.pixels())
            .map(|pixel| {
                let beam = aim.beam(sensor, &sweep.ray(pixel));
                let from = place + turn * beam.from_m;
                let farthest_along_m = limits_m.end() + beam.beside_m.length();
                let hit = scene.hit(from.to_array(), (turn * beam.direction).to_array(), farthest_along_m)?;
                let range_m = (beam.beside_m + beam.from_sensor * hit.distance_m).length();
                limits_m.contains(&range_m).then(|| Echo {
                    range_m,
                    incidence_rad: hit.incidence_rad,
                    reflectance: f64::from(hit.material.reflectance),
                    class: class_of(hit.material.label),
                })
            })
            .collect();
        sweep
    }

    /// The ray of a pixel, as described.
    pub(crate) fn ray(&self, pixel: usize) -> Ray {
        let columns = self.sensor.columns();
        let (ring, column) = (pixel / columns, pixel % columns);
        let described = self.sensor.rings()[ring];
        Ray {
            pixel,
            ring,
            azimuth_rad: self.sensor.azimuth_rad(column) + described.azimuth_offset_rad,
            elevation_rad: described.elevation_rad,
            phase: (column as f64 + 0.5) / columns as f64,
        }
    }

    /// What each ray met.
    pub(crate) fn echoes(&self) -> &[Option<Echo>] {
        &self.echoes
    }

    /// The ray of a pixel that met something.
    pub(crate) fn shot(&self, pixel: usize) -> Option<Shot<'_>> {
        Some(Shot { sweep: self, ray: self.ray(pixel), echo: self.echoes[pixel]? })
    }

    /// Echoes of the pixels above, below, left and right; the columns close into a turn.
    pub(crate) fn neighbours(&self, pixel: usize) -> impl Iterator<Item = Echo> {
        let (rings, columns) = (self.sensor.rings().len(), self.sensor.columns());
        let (ring, column) = (pixel / columns, pixel % columns);
        let beside = [(column + 1) % columns, (column + columns - 1) % columns].map(|c| Some(ring * columns + c));
        let above = (ring > 0).then(|| pixel - columns);
        let below = (ring + 1 < rings).then(|| pixel + columns);
        beside.into_iter().chain([above, below]).flatten().filter_map(|i| self.echoes[i])
    }

    /// The sweep as an ideal sensor reports it, with classes.
    pub(crate) fn image(&self) -> RangeImage {
        let mut image = RangeImage::empty(self.sensor.rings().len(), self.sensor.columns());
        for (pixel, echo) in self.echoes.iter().enumerate() {
            if let Some(echo) = echo {
                image.set(pixel, echo.range_m as f32, echo.reflectance as f32, echo.class);
            }
        }
        image
    }
}

impl Shot<'_> {
    /// Height above a level ground under the sensor.
    pub(crate) fn height_m(&self) -> f64 {
        self.echo.range_m * self.ray.elevation_rad.sin() + f64::from(scene::pose::SENSOR_HEIGHT_M)
    }
}
