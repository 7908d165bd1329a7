//! What a projection loses: points, and millimetres of those that come back.

use serde::Serialize;

use super::{NO_PIXEL, Projection, ProjectionError, Projector};
use crate::cloud::PointCloud;
use crate::sensor::{Sensor, SensorError};

/// A way to project, to be measured.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// What a reader calls it.
    pub name: String,
    /// The grid.
    pub sensor: Sensor,
    /// Tell rings by elevation alone, though the clouds' field or order may tell them better.
    pub by_elevation: bool,
}

/// What a projection loses of some scans.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Loss {
    /// Name of the projection.
    pub name: String,
    /// Rings of the grid.
    pub rings: usize,
    /// Columns of the grid.
    pub columns: usize,
    /// Points of all scans.
    pub points: usize,
    /// Points that lost their pixel to a nearer one.
    pub lost: usize,
    /// Points without a pixel for another reason: none at all, out of range, outside the view.
    pub outside: usize,
    /// Distance between a point that has a pixel and where image and sensor alone put it: the largest, in metres.
    pub max_error_m: f64,
    /// The same: 99.9 % of the points are within it.
    pub p999_error_m: f64,
}

impl Loss {
    /// Lost points in percent of all.
    pub fn lost_percent(&self) -> f64 {
        100.0 * self.lost as f64 / self.points.max(1) as f64
    }
}

/// The projections of a usual comparison: even elevations from the model sensor's top to its bottom at 1024 and 2048 columns by
/// elevation, the model itself by elevation, by ring at 2048 columns, and the estimated grid.
///
/// For HDL-64E the even elevations are those of the literature, +3 to −25°.
pub fn usual_candidates(model: &Sensor, estimated: &Sensor) -> Result<Vec<Candidate>, SensorError> {
    let uniform =
        if *model == Sensor::builtin("hdl64e")? { Sensor::builtin("hdl64e-uniform")? } else { uniform(model)? };
    let candidate =
        |name: &str, sensor: Sensor, by_elevation: bool| Candidate { name: name.into(), sensor, by_elevation };
    Ok(vec![
        candidate("uniform elevation", uniform.clone().with_columns(1024)?, true),
        candidate("uniform elevation", uniform.with_columns(2048)?, true),
        candidate(&format!("{}, by elevation", model.name), model.clone(), true),
        candidate(&format!("{}, by ring", model.name), model.clone().with_columns(2048)?, false),
        candidate("estimated grid", estimated.clone(), false),
    ])
}

/// Projects all the scans in each way.
pub fn losses(clouds: &[PointCloud], candidates: &[Candidate]) -> Result<Vec<Loss>, ProjectionError> {
    candidates.iter().map(|candidate| loss(clouds, candidate)).collect()
}

/// Projects all the scans in one way, and back by the image and the sensor alone.
pub fn loss(clouds: &[PointCloud], candidate: &Candidate) -> Result<Loss, ProjectionError> {
    let sensor = &candidate.sensor;
    let mut projector = Projector::new(sensor);
    if candidate.by_elevation {
        projector = projector.by_elevation();
    }
    let mut projection = Projection::default();
    let (mut points, mut lost, mut projected) = (0, 0, 0);
    let mut errors_m: Vec<f64> = Vec::new();
    for cloud in clouds {
        projector.project_into(cloud, &mut projection)?;
        points += projection.report.points_in;
        lost += projection.report.lost;
        projected += projection.report.projected;
        for (i, pixel) in projection.pixel_of_point.iter().enumerate().filter(|(_, pixel)| **pixel != NO_PIXEL) {
            let (ring, column) = (*pixel as usize / sensor.columns(), *pixel as usize % sensor.columns());
            let back = sensor.point_m(ring, column, f64::from(projection.image.range_m()[*pixel as usize]));
            let there = [cloud.x[i], cloud.y[i], cloud.z[i]].map(f64::from);
            // As a cloud stores it, in single precision.
            let squared = |(a, b): (&f64, &f64)| (f64::from(*a as f32) - b).powi(2);
            errors_m.push(back.iter().zip(&there).map(squared).sum::<f64>().sqrt());
        }
    }
    let last = errors_m.len().saturating_sub(1);
    errors_m.sort_unstable_by(f64::total_cmp);
    Ok(Loss {
        name: candidate.name.clone(),
        rings: sensor.rings().len(),
        columns: sensor.columns(),
        points,
        lost,
        outside: points - lost - projected,
        max_error_m: errors_m.last().copied().unwrap_or(0.0),
        p999_error_m: errors_m.get(last * 999 / 1000).copied().unwrap_or(0.0),
    })
}

/// As many rings, evenly between the sensor's highest and lowest.
fn uniform(sensor: &Sensor) -> Result<Sensor, SensorError> {
    let elevations_deg = || sensor.rings().iter().map(|r| r.elevation_rad.to_degrees());
    let top = elevations_deg().fold(f64::NEG_INFINITY, f64::max);
    let bottom = elevations_deg().fold(f64::INFINITY, f64::min);
    let n = sensor.rings().len();
    let step = if n > 1 { (top - bottom) / (n - 1) as f64 } else { 0.0 };
    let name = format!("{}, uniform elevations", sensor.name);
    let even = (0..n).map(|i| top - step * i as f64);
    Sensor::from_elevations_deg(&name, even, sensor.columns(), sensor.range_limits_m(), sensor.rotation_hz())
}
