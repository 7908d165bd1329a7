//! One scan of a set: read, checked by itself, projected.

use std::path::Path;

use lidar::formats::{self, Limits};
use lidar::{PointCloud, Projector, RangeImage};

use super::notice::Notice;
use super::units::{self, quantile, strided};
use super::{Defect, DefectKind, SetError, columns, rays};

/// A scan on the sensor's grid.
#[derive(Debug)]
pub(super) struct Scan {
    pub(super) image: RangeImage,
    /// Points that lost their pixel to a nearer one.
    pub(super) lost: usize,
    /// Points of the cloud.
    pub(super) points: usize,
    /// Points nearer or farther than the sensor sees.
    pub(super) out_of_range: usize,
    /// Median of all points, whether the sensor sees them or not.
    pub(super) median_range_m: f32,
    pub(super) labelled: bool,
    /// Intensity that was taken to mean 1.
    pub(super) full_scale: f32,
    pub(super) notices: Vec<(Notice, usize)>,
}

/// Reads a scan; what can be told of it without its twin is right afterwards, its range unit and its having returns excepted.
pub(super) fn read(path: &Path, sensor_file: &Path, projector: &mut Projector) -> Result<Scan, SetError> {
    let mut cloud = formats::read(path, &Limits::default())?;
    check_finite(path, &cloud)?;
    let mut notices = Vec::from_iter(units::check_intensity(path, &mut cloud)?);
    units::check_elevations(sensor_file, path, &cloud, projector.sensor())?;
    rays::check_ring_numbers(path, &cloud, projector.sensor().rings().len())?;
    let ranges_m: Vec<f32> = (0..cloud.len()).map(|i| cloud.range_m(i)).collect();
    let (points, at_origin) = (cloud.len(), ranges_m.iter().filter(|r| **r == 0.0).count());
    let mut sample: Vec<f32> = strided(points).map(|i| ranges_m[i]).filter(|r| *r > 0.0).collect();
    // Points that the sensor cannot have seen, its own car's say, would mislead whoever tells rings by their points.
    let (min_m, max_m) = projector.sensor().range_limits_m();
    let seen = |i: &u32| (min_m..=max_m).contains(&ranges_m[*i as usize]) && ranges_m[*i as usize] > 0.0;
    let kept: Vec<u32> = (0..points as u32).filter(seen).collect();
    if kept.len() < points {
        cloud = cloud.select(&kept);
    }
    let projection = projector.project(&cloud).map_err(|source| SetError::Projection { path: path.into(), source })?;
    let scan = Scan {
        image: RangeImage::default(),
        lost: projection.report.lost,
        points,
        out_of_range: points - kept.len() - at_origin,
        median_range_m: quantile(&mut sample, 0.5),
        labelled: cloud.label.is_some(),
        full_scale: cloud.full_scale,
        notices: Vec::new(),
    };
    // Of a scan in another unit hardly a point is left to look at; the unit is what is wrong with it.
    if !units::out_of_reach(&scan, projector.sensor()) {
        notices.extend(rays::check(path, &cloud, &projection, projector.sensor())?);
        notices.extend(columns::check(path, &cloud, &projection, projector.sensor())?);
    }
    let counted = [
        (Notice::AtOrigin, at_origin),
        (Notice::OutOfRange, scan.out_of_range),
        (Notice::OutsideView, projection.report.outside_view),
    ];
    notices.extend(counted.into_iter().filter(|(_, points)| *points > 0));
    Ok(Scan { image: projection.image, notices, ..scan })
}

/// Refuses a scan without a return: there is nothing to compare.
pub(super) fn check_returns(file: &Path, image: &RangeImage) -> Result<(), SetError> {
    if image.returns() > 0 {
        return Ok(());
    }
    Err(Box::new(Defect {
        kind: DefectKind::NoReturns,
        file: file.into(),
        field: "x, y, z",
        found: "no return: every ray was dropped".into(),
        expected: "at least one point that the sensor can see".into(),
        fix: "Leave the frame out of both folders, or export it again.".into(),
    })
    .into())
}

fn check_finite(path: &Path, cloud: &PointCloud) -> Result<(), SetError> {
    let fields = [("x", &cloud.x), ("y", &cloud.y), ("z", &cloud.z), ("intensity", &cloud.intensity)];
    for (field, values) in fields {
        let Some(first) = values.iter().position(|value| !value.is_finite()) else { continue };
        let count = values.iter().filter(|value| !value.is_finite()).count();
        return Err(Box::new(Defect {
            kind: DefectKind::NotFinite,
            file: path.into(),
            field,
            found: format!("{count} of {} values are NaN or infinite, the first is that of point {first}", cloud.len()),
            expected: "finite numbers".into(),
            fix: "A ray without a return is no point: leave it out.".into(),
        })
        .into());
    }
    Ok(())
}

/// Refuses scans whose intensities were read on different scales.
pub(super) fn check_one_scale<'a>(scans: impl Iterator<Item = (&'a Path, &'a Scan)>) -> Result<(), SetError> {
    let mut lit = scans.filter(|(_, scan)| scan.notices.iter().all(|(notice, _)| *notice != Notice::NoIntensity));
    let Some((first, model)) = lit.next() else { return Ok(()) };
    let Some((path, other)) = lit.find(|(_, scan)| scan.full_scale != model.full_scale) else { return Ok(()) };
    Err(Box::new(Defect {
        kind: DefectKind::IntensityUnit,
        file: path.into(),
        field: "intensity",
        found: format!("{} seems to mean a reflectance of 1", other.full_scale),
        expected: format!("{}, as in {}", model.full_scale, first.display()),
        fix: "Store all scans' intensities from 0 to 1.".into(),
    })
    .into())
}
