//! Whether a scan's points are as far apart in azimuth as the sensor's columns.

use std::f64::consts::TAU;
use std::path::Path;

use lidar::projection::NO_PIXEL;
use lidar::{PointCloud, Projection, Sensor};

use super::notice::Notice;
use super::{Defect, DefectKind, SetError};

/// Rings that are looked at.
const RINGS: usize = 8;

/// Steps that a claim takes.
const MIN_STEPS: usize = 200;

/// Steps below this share of a column are two returns of one ray.
const SAME_RAY: f64 = 0.02;

/// The column count may be off by this share: rotation speeds wander, and a turn of 2083 firings is not one of 2048.
const MAX_OFF: f64 = 0.05;

/// Off by this share it is worth a note.
const USUALLY_OFF: f64 = 0.003;

/// Steps that differ more than this between their quartiles are not those of a grid, and say nothing.
const MAX_SPREAD: f64 = 0.05;

/// Share of the steps that must be of one column: an HDL-64E fires every second tick of its encoder, but now and then after one.
const MIN_SINGLE: f64 = 0.4;

/// Refuses a scan whose columns are another sensor's.
pub(super) fn check(
    path: &Path,
    cloud: &PointCloud,
    projection: &Projection,
    sensor: &Sensor,
) -> Result<Option<(Notice, usize)>, SetError> {
    let mut steps = steps(cloud, projection, sensor);
    if steps.len() < MIN_STEPS {
        return Ok(None);
    }
    steps.sort_unstable_by(f64::total_cmp);
    // Dropped rays make steps of two columns and more; the shortest common step is one column, of whatever grid this is.
    let shortest = steps[steps.len() / 20];
    let single: Vec<f64> = steps.iter().copied().filter(|step| (step / shortest - 1.0).abs() < 0.2).collect();
    let at = |q: usize| single[(single.len() - 1) * q / 4];
    let (step, spread) = (at(2), at(3) - at(1));
    if spread > MAX_SPREAD * step || (single.len() as f64) < MIN_SINGLE * steps.len() as f64 {
        return Ok(None);
    }
    if (step - 1.0).abs() <= MAX_OFF {
        return Ok(((step - 1.0).abs() > USUALLY_OFF).then_some((Notice::ColumnsDrift, cloud.len())));
    }
    Err(Box::new(Defect {
        kind: DefectKind::ColumnCount,
        file: path.into(),
        field: "x, y",
        found: format!(
            "neighbouring points of a ring are {:.3}° apart, {:.0} columns a turn",
            360.0 * step / sensor.columns() as f64,
            sensor.columns() as f64 / step
        ),
        expected: format!(
            "{:.3}°, for sensor.toml has columns = {}",
            360.0 / sensor.columns() as f64,
            sensor.columns()
        ),
        fix: "Is sensor.toml that of the sensor that these scans are of?".into(),
    })
    .into())
}

/// Steps in azimuth between neighbouring points of a few rings, in columns.
fn steps(cloud: &PointCloud, projection: &Projection, sensor: &Sensor) -> Vec<f64> {
    let rings = sensor.rings().len();
    let every = rings.div_ceil(RINGS);
    let mut places: Vec<Vec<f64>> = vec![Vec::new(); rings.div_ceil(every)];
    for (i, pixel) in projection.pixel_of_point.iter().enumerate() {
        let ring = *pixel as usize / sensor.columns();
        // A point that lost its pixel has no ring any more, unless its field tells.
        let ring = if *pixel == NO_PIXEL { cloud.ring.as_ref().map_or(rings, |f| usize::from(f[i])) } else { ring };
        if ring < rings && ring.is_multiple_of(every) {
            let (x, y) = (f64::from(cloud.x[i]), f64::from(cloud.y[i]));
            let beside = (sensor.rings()[ring].lateral_m / x.hypot(y)).clamp(-1.0, 1.0).asin();
            places[ring / every].push((y.atan2(x) - beside) / TAU * sensor.columns() as f64);
        }
    }
    let mut steps = Vec::new();
    for places in &mut places {
        places.sort_unstable_by(f64::total_cmp);
        steps.extend(places.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > SAME_RAY));
    }
    steps
}
