//! Units that a scan is in: metres, intensities from 0 to 1, degrees in the sensor's file.

use std::path::Path;

use lidar::formats::Format;
use lidar::{PointCloud, Sensor};

use super::notice::Notice;
use super::scan::Scan;
use super::{Defect, DefectKind, SetError};

/// Intensities past this one are no reflectances: a gain of two on a white wall, twice.
const BRIGHTEST: f32 = 4.0;

/// An honest sensor's ranges differ less than so many times from the simulator's in the median, whatever it drops.
const MAX_MEDIAN_RATIO: f32 = 30.0;

/// Elevations of a real sensor in degrees reach past this one; in radians it is 34°, farther than most sensors look.
const LOW_ELEVATION_DEG: f64 = 0.6;

/// Points that quantiles are taken of.
const SAMPLE: usize = 4096;

/// Finds out which intensity of the cloud means 1, and sets its full scale so.
///
/// Readers guess the scale of floats by their maximum; a gain that lifts reflectances past 1 must not be taken for another unit, and
/// 0–255 or 0–100 must not be taken for reflectances.
pub(super) fn check_intensity(path: &Path, cloud: &mut PointCloud) -> Result<Option<(Notice, usize)>, SetError> {
    if cloud.intensity.iter().all(|intensity| *intensity == 0.0) {
        return Ok(Some((Notice::NoIntensity, cloud.len())));
    }
    // These formats fix the scale.
    let fixed = matches!(Format::from_path(path), Some(Format::NuScenes | Format::Las | Format::Laz));
    let mut sample: Vec<f32> = strided(cloud.len()).map(|i| cloud.intensity[i]).collect();
    let (median, high) = (quantile(&mut sample, 0.5), quantile(&mut sample, 0.99));
    let found = || {
        let highest = cloud.intensity.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        format!("99 % are below {high}, half below {median}, the highest is {highest}")
    };
    if median < 0.0 {
        return Err(intensity_unit(path, found(), "Are these decibels? Store reflectances."));
    }
    let whole = cloud.intensity.iter().all(|intensity| intensity.fract() == 0.0);
    if high > BRIGHTEST && !fixed {
        if whole && cloud.full_scale > 1.0 {
            return Ok(Some((Notice::WholeIntensity, cloud.len())));
        }
        let scale = match high {
            ..=100.0 => "0–100 or 0–255: divide by 100 or 255",
            ..=255.0 => "0–255: divide by 255",
            _ => "0–65535: divide by 65535",
        };
        return Err(intensity_unit(path, found(), &format!("It looks like {scale}.")));
    }
    if cloud.full_scale > 1.0 && !whole && !fixed {
        cloud.full_scale = 1.0;
    }
    let bright = cloud.intensity.iter().filter(|intensity| **intensity > cloud.full_scale).count();
    Ok((bright > 0).then_some((Notice::TooBright, bright)))
}

fn intensity_unit(path: &Path, found: String, fix: &str) -> SetError {
    let expected = "reflectances from 0 to 1".into();
    let kind = DefectKind::IntensityUnit;
    Box::new(Defect { kind, file: path.into(), field: "intensity", found, expected, fix: fix.into() }).into()
}

/// Tells a sensor's file in radians from the elevations of a scan's points.
pub(super) fn check_elevations(
    sensor_file: &Path,
    path: &Path,
    cloud: &PointCloud,
    sensor: &Sensor,
) -> Result<(), SetError> {
    let highest = |elevations: &mut dyn Iterator<Item = f64>| elevations.map(f64::abs).fold(0.0, f64::max);
    let stated_deg = highest(&mut sensor.rings().iter().map(|ring| ring.elevation_rad.to_degrees()));
    if stated_deg == 0.0 || stated_deg >= LOW_ELEVATION_DEG {
        return Ok(());
    }
    let elevation_deg =
        |i: usize| f64::from(cloud.z[i]).atan2(f64::from(cloud.x[i]).hypot(f64::from(cloud.y[i]))).abs().to_degrees();
    let mut seen: Vec<f32> = strided(cloud.len()).map(|i| elevation_deg(i) as f32).collect();
    let seen_deg = f64::from(quantile(&mut seen, 0.95));
    // As degrees they are far too low for these points, as radians just right.
    if seen_deg < 5.0 * stated_deg + 1.0 || seen_deg > 1.3 * stated_deg.to_degrees() + 2.0 {
        return Ok(());
    }
    Err(Box::new(Defect {
        kind: DefectKind::AngleUnit,
        file: sensor_file.into(),
        field: "elevation_deg",
        found: format!(
            "no ring is more than {stated_deg:.3}° from the horizon, but points of {} are up to {seen_deg:.1}°",
            path.display()
        ),
        expected: "degrees".into(),
        fix: "It looks like radians: multiply by 180/π.".into(),
    })
    .into())
}

/// Tells ranges that are not in metres, by the sensor's limits and by the median range of scans of the same places.
pub(super) fn check_ranges(path: &Path, scan: &Scan, sensor: &Sensor, others_m: Option<f32>) -> Result<(), SetError> {
    let (min_m, max_m) = sensor.range_limits_m();
    let outside = out_of_reach(scan, sensor);
    let ratio = others_m.filter(|m| *m > 0.0).map(|m| scan.median_range_m / m);
    let far_apart = ratio.is_some_and(|r| !(1.0 / MAX_MEDIAN_RATIO..=MAX_MEDIAN_RATIO).contains(&r));
    if !outside && !far_apart {
        return Ok(());
    }
    let against = ratio.filter(|_| far_apart).map(|r| format!(", {r:.4} of its twins'")).unwrap_or_default();
    // Against the twin if that says anything; alone, a street's median is about ten metres.
    let factor = if far_apart { ratio.unwrap_or(1.0) } else { scan.median_range_m / 10.0 };
    let fix = match unit(factor) {
        Some((unit, metres)) => format!("It looks like {unit}: multiply by {metres}."),
        None => "Is the cloud in metres, and are the sensor's limits right?".into(),
    };
    Err(Box::new(Defect {
        kind: DefectKind::RangeUnit,
        file: path.into(),
        field: "x, y, z",
        found: format!(
            "the median range is {} m{against}, and {} of {} points are out of the sensor's range",
            scan.median_range_m, scan.out_of_range, scan.points
        ),
        expected: format!("metres, from range_min_m = {min_m} to range_max_m = {max_m}"),
        fix,
    })
    .into())
}

/// True for a scan that the sensor cannot have measured in metres: most points are too far away, or hardly any is far enough.
///
/// Half of an honest scan may be of the sensor's own car, nearer than it is said to see.
pub(super) fn out_of_reach(scan: &Scan, sensor: &Sensor) -> bool {
    scan.median_range_m > sensor.range_limits_m().1 || scan.out_of_range * 20 > scan.points * 19
}

/// The unit that makes numbers `factor` times too large, and its length in metres.
pub(super) fn unit(factor: f32) -> Option<(&'static str, f32)> {
    let within = |at: f32, times: f32| factor > at / times && factor < at * times;
    match () {
        () if within(1000.0, 3.0) => Some(("millimetres", 0.001)),
        () if within(100.0, 3.0) => Some(("centimetres", 0.01)),
        () if within(10.0, 1.1) => Some(("decimetres", 0.1)),
        () if within(3.281, 1.05) => Some(("feet", 0.3048)),
        () if within(0.001, 3.0) => Some(("kilometres", 1000.0)),
        () => None,
    }
}

/// Evenly spread indices of `len` things.
pub(super) fn strided(len: usize) -> std::iter::StepBy<std::ops::Range<usize>> {
    (0..len).step_by(len.div_ceil(SAMPLE).max(1))
}

/// The value that the share `q` of the values is below; NaN of none.
pub(super) fn quantile(values: &mut [f32], q: f64) -> f32 {
    if values.is_empty() {
        return f32::NAN;
    }
    let at = ((values.len() - 1) as f64 * q).round() as usize;
    *values.select_nth_unstable_by(at, f32::total_cmp).1
}
