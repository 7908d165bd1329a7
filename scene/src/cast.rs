//! Casting a sensor's rays at a scene.

use glam::DVec3;
use lidar::cloud::Column;
use lidar::label::class_of;
use lidar::{PointCloud, RangeImage, Sensor};
use rayon::prelude::*;

use crate::material::Material;
use crate::pose::{Motion, Pose, WorldFromSensor};
use crate::scene::Scene;

/// An ideal scan: what a sensor without noise or drop would report, as points and as images of the same rays.
#[derive(Clone, Debug, PartialEq)]
pub struct Cast {
    /// The returns, ring by ring, column by column, in the sensor's frame at the moment their column fired: intensity is the
    /// surface's reflectance (full scale 1), with ring, label, time since the sweep's start, and the extra columns
    /// `incidence_rad`, `normal_x`, `normal_y`, `normal_z` (`f32`, unit normal on the side that the ray met, in the same frame).
    pub cloud: PointCloud,
    /// The same returns on the sensor's own grid.
    pub image: RangeImage,
    /// Angle between ray and normal, `[ring, column]`: 0 is head-on, and where there is no return.
    pub incidence_rad: Vec<f32>,
    /// Unit normal in the sensor's frame, `[ring, column]`: zero where there is no return.
    pub normal: Vec<[f32; 3]>,
}

/// One ray's return.
#[derive(Clone, Copy)]
struct Return {
    at_m: [f32; 3],
    range_m: f32,
    normal: [f32; 3],
    incidence_rad: f32,
    material: Material,
}

/// Rays that one thread casts in a row: neighbours meet the same triangles.
const RAYS_A_TASK: usize = 512;

/// Casts one sweep: column c fires c / columns of a turn after the sweep's start, from where the sensor is then.
///
/// A ray leaves from the ring's own beam origin; its range is the distance of the return from the sensor's origin. Surfaces nearer
/// or farther than the sensor sees give no return, and nearer ones hide what is behind them.
pub fn cast(scene: &Scene, sensor: &Sensor, pose: &Pose, motion: &Motion) -> Cast {
    let (rings, columns) = (sensor.rings().len(), sensor.columns());
    let frames: Vec<WorldFromSensor> = (0..columns).map(|c| pose.after(motion, column_time_s(sensor, c))).collect();
    let mut returns: Vec<Option<Return>> = vec![None; rings * columns];
    returns.par_chunks_mut(RAYS_A_TASK).enumerate().for_each(|(task, chunk)| {
        for (i, to) in chunk.iter_mut().enumerate() {
            let pixel = task * RAYS_A_TASK + i;
            let (ring, column) = (pixel / columns, pixel % columns);
            *to = cast_ray(scene, sensor, &frames[column], ring, column);
        }
    });
    collect(sensor, &returns)
}

/// Seconds after the sweep's start at which a column fires.
pub fn column_time_s(sensor: &Sensor, column: usize) -> f64 {
    column as f64 / (sensor.columns() as f64 * f64::from(sensor.rotation_hz()))
}

fn cast_ray(scene: &Scene, sensor: &Sensor, frame: &WorldFromSensor, ring: usize, column: usize) -> Option<Return> {
    let (nearest_m, farthest_m) = sensor.range_limits_m();
    let origin = DVec3::from_array(sensor.origin_m(ring, column));
    let direction = DVec3::from_array(sensor.direction(ring, column));
    let from = frame.translation_m + frame.rotation * origin;
    let farthest_along_ray_m = f64::from(farthest_m) + origin.length();
    let hit = scene.hit(from.to_array(), (frame.rotation * direction).to_array(), farthest_along_ray_m)?;
    let at = (origin + direction * hit.distance_m).as_vec3();
    // The point as stored decides, and by PointCloud::range_m's formula: the image and the cloud agree to the last bit.
    let range_m = (at.x * at.x + at.y * at.y + at.z * at.z).sqrt();
    let normal = frame.rotation.transpose() * DVec3::from_array(hit.normal);
    (range_m >= nearest_m && range_m <= farthest_m && range_m > 0.0).then(|| Return {
        at_m: at.to_array(),
        range_m,
        normal: normal.as_vec3().to_array(),
        incidence_rad: hit.incidence_rad as f32,
        material: hit.material,
    })
}

fn collect(sensor: &Sensor, returns: &[Option<Return>]) -> Cast {
    let columns = sensor.columns();
    let count = returns.iter().flatten().count();
    let column = || Vec::with_capacity(count);
    let mut cloud = PointCloud { x: column(), y: column(), z: column(), intensity: column(), ..PointCloud::new(1.0) };
    let (mut ring, mut label, mut time_s) =
        (Vec::with_capacity(count), Vec::with_capacity(count), Vec::with_capacity(count));
    let mut extra = [column(), column(), column(), column()];
    let mut image = RangeImage::empty(sensor.rings().len(), columns);
    let mut incidence_rad = vec![0.0; returns.len()];
    let mut normal = vec![[0.0; 3]; returns.len()];
    for (pixel, one) in returns.iter().enumerate() {
        let Some(one) = one else { continue };
        cloud.x.push(one.at_m[0]);
        cloud.y.push(one.at_m[1]);
        cloud.z.push(one.at_m[2]);
        cloud.intensity.push(one.material.reflectance);
        ring.push((pixel / columns) as u16);
        label.push(one.material.label);
        time_s.push(column_time_s(sensor, pixel % columns));
        for (to, value) in extra.iter_mut().zip([one.incidence_rad, one.normal[0], one.normal[1], one.normal[2]]) {
            to.push(value);
        }
        image.set(pixel, one.range_m, one.material.reflectance, class_of(one.material.label));
        incidence_rad[pixel] = one.incidence_rad;
        normal[pixel] = one.normal;
    }
    (cloud.ring, cloud.label, cloud.time_s) = (Some(ring), Some(label), Some(time_s));
    cloud.extra = ["incidence_rad", "normal_x", "normal_y", "normal_z"]
        .into_iter()
        .zip(extra)
        .map(|(name, values)| Column { name: name.into(), values: values.into() })
        .collect();
    Cast { cloud, image, incidence_rad, normal }
}
