//! Whether a scan's points lie on the sensor's rings.

use std::path::Path;

use lidar::projection::NO_PIXEL;
use lidar::{PointCloud, Projection, RingSource, Sensor};

use super::notice::Notice;
use super::units::strided;
use super::{Defect, DefectKind, SetError};

/// A point may be this far above or below its ring's ray, whatever the rings' spacing: a sensor that is off by as much is the same one.
///
/// An HDL-64E's beams leave the axis 0.2 m above the origin: described without that, they are 2° off at 6 m.
const TOLERANCE_RAD: f64 = 2.5 * std::f64::consts::PI / 180.0;

/// Spacing that a single ring is taken to have.
const LONE_SPACING_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;

/// Share of the points that must fit.
const MIN_FITTING: f64 = 0.5;

/// The same where rings are told by elevation alone: there half of the points of any sensor lie within a quarter of the spacing.
const MIN_FITTING_BY_ELEVATION: f64 = 0.7;

/// Below this share it is worth a note.
const USUALLY_FITTING: f64 = 0.99;

/// Share of points with rings past the last that makes them another sensor's, not mistakes.
const MANY: f64 = 0.01;

/// Refuses ring numbers that the sensor does not have.
pub(super) fn check_ring_numbers(path: &Path, cloud: &PointCloud, rings: usize) -> Result<(), SetError> {
    let Some(field) = &cloud.ring else { return Ok(()) };
    let too_high = |ring: &u16| usize::from(*ring) >= rings;
    let Some(first) = field.iter().position(too_high) else { return Ok(()) };
    let count = field.iter().filter(|ring| too_high(ring)).count();
    let (lowest, highest) = field.iter().fold((u16::MAX, 0), |(low, high), ring| (low.min(*ring), high.max(*ring)));
    let many = count as f64 > MANY * field.len() as f64;
    let from_one = usize::from(highest) == rings && lowest > 0;
    let (kind, fix) = match (from_one, many) {
        (true, _) => (DefectKind::RingOutOfRange, "Rings seem to be numbered from 1: subtract 1."),
        (_, true) => (DefectKind::RingCount, "Is sensor.toml that of the sensor that these scans are of?"),
        _ => (DefectKind::RingOutOfRange, "Leave these points out, or export the scan again."),
    };
    let expected = format!("0 to {}, for sensor.toml's elevation_deg has {rings} rings", rings - 1);
    let found =
        format!("{lowest} to {highest}; {count} of {} points are past the last ring, first point {first}", field.len());
    Err(Box::new(Defect { kind, file: path.into(), field: "ring", found, expected, fix: fix.into() }).into())
}

/// Refuses a scan of another sensor; says how its rings were told where its field did not.
pub(super) fn check(
    path: &Path,
    cloud: &PointCloud,
    projection: &Projection,
    sensor: &Sensor,
) -> Result<Vec<(Notice, usize)>, SetError> {
    if cloud.is_empty() {
        return Ok(Vec::new());
    }
    let source = projection.report.ring_source;
    let mut notices = Vec::new();
    if let (Some(field), false) = (&cloud.ring, source == RingSource::Field) {
        // The field's rings look elsewhere than the sensor's by degrees.
        return Err(off_rays(path, "ring", &Fit::of(cloud, sensor, |i| Some(usize::from(field[i]))), sensor, field));
    }
    let ring = |i: usize| {
        let pixel = projection.pixel_of_point[i];
        (pixel != NO_PIXEL).then(|| pixel as usize / sensor.columns())
    };
    let fit = Fit { unseen: projection.report.outside_view, ..Fit::of(cloud, sensor, ring) };
    let by_elevation = source == RingSource::Elevation;
    let share = if by_elevation { fit.in_quarter_share() } else { fit.share() };
    // Scans with hardly a point cannot tell.
    if fit.looked_at >= 32 && share < if by_elevation { MIN_FITTING_BY_ELEVATION } else { MIN_FITTING } {
        let field = cloud.ring.as_deref().unwrap_or_default();
        return Err(off_rays(path, if by_elevation { "x, y, z" } else { "ring" }, &fit, sensor, field));
    }
    match (source, &cloud.ring) {
        (RingSource::Order, _) => notices.push((Notice::RingsByOrder, cloud.len())),
        (RingSource::Elevation, _) => notices.push((Notice::RingsByElevation, cloud.len())),
        (RingSource::Field, Some(field)) => {
            let renumbered = |i: &usize| ring(*i).is_some_and(|ring| ring != usize::from(field[*i]));
            let points = (0..cloud.len()).filter(renumbered).count();
            notices.extend((points > 0).then_some((Notice::RingsRenumbered, points)));
        }
        (RingSource::Field, None) | (RingSource::Counts, _) => {}
    }
    if share < USUALLY_FITTING {
        notices.push((Notice::OffRays, fit.looked_at - fit.fitting));
    }
    Ok(notices)
}

fn off_rays(path: &Path, field: &'static str, fit: &Fit, sensor: &Sensor, rings: &[u16]) -> SetError {
    let mut seen: Vec<u16> = rings.to_vec();
    seen.sort_unstable();
    seen.dedup();
    let (stated, fewer) = (sensor.rings().len(), rings.last().is_some() && seen.len() * 4 < sensor.rings().len() * 3);
    let (kind, count) = if fewer {
        (DefectKind::RingCount, format!("{} rings have points and ", seen.len()))
    } else {
        (DefectKind::OffRays, String::new())
    };
    let above = match fit.unseen {
        0 => String::new(),
        unseen => format!("{unseen} of {} points are above or below every ring, ", fit.points),
    };
    let (lying, fix) = if field == "ring" {
        let half = format!("half of them are more than {:.2}° off", fit.median_off_rad.to_degrees());
        (
            format!("{:.0} % of the points lie on their ring's ray; {half}", 100.0 * fit.share()),
            "Another sensor? Is z up, and is elevation_deg in degrees and in the order of the ring field?",
        )
    } else {
        (
            format!(
                "{:.0} % of the points lie near a ray, within a quarter of the rings' spacing",
                100.0 * fit.in_quarter_share()
            ),
            "Another sensor? Is z up, and is elevation_deg exact? A `ring` field would tell the rings.",
        )
    };
    Box::new(Defect {
        kind,
        file: path.into(),
        field,
        found: format!("{count}{above}{lying}"),
        expected: format!("points on the {stated} rays of sensor.toml's elevation_deg"),
        fix: fix.into(),
    })
    .into()
}

/// How far points are above or below the rays of their rings.
#[derive(Debug, Default)]
struct Fit {
    looked_at: usize,
    /// Within half a ring's spacing, or within the tolerance if that is more.
    fitting: usize,
    in_quarter: usize,
    median_off_rad: f64,
    /// Points that no ring sees, of the whole cloud.
    unseen: usize,
    points: usize,
}

impl Fit {
    fn of(cloud: &PointCloud, sensor: &Sensor, ring: impl Fn(usize) -> Option<usize>) -> Self {
        let spacings = spacings_rad(sensor);
        let mut fit = Self { points: cloud.len(), ..Self::default() };
        let mut off: Vec<f64> = Vec::new();
        for i in strided(cloud.len()) {
            let Some((ring, beam)) = ring(i).and_then(|ring| Some((ring, sensor.rings().get(ring)?))) else { continue };
            let (x, y, z) = (f64::from(cloud.x[i]), f64::from(cloud.y[i]), f64::from(cloud.z[i]));
            let along_m = (x * x + y * y - beam.lateral_m * beam.lateral_m).max(0.0).sqrt();
            if along_m == 0.0 {
                continue;
            }
            let off_rad = ((z - beam.height_m).atan2(along_m) - beam.elevation_rad).abs();
            fit.looked_at += 1;
            fit.fitting += usize::from(off_rad <= (spacings[ring] / 2.0).max(TOLERANCE_RAD));
            fit.in_quarter += usize::from(off_rad <= spacings[ring] / 4.0);
            off.push(off_rad);
        }
        off.sort_unstable_by(f64::total_cmp);
        fit.median_off_rad = off.get(off.len() / 2).copied().unwrap_or(0.0);
        fit
    }

    /// Share of the cloud's points that some ring sees.
    fn seen(&self) -> f64 {
        1.0 - self.unseen as f64 / self.points.max(1) as f64
    }

    fn share(&self) -> f64 {
        self.seen() * self.fitting as f64 / self.looked_at.max(1) as f64
    }

    fn in_quarter_share(&self) -> f64 {
        self.seen() * self.in_quarter as f64 / self.looked_at.max(1) as f64
    }
}

/// Angle from each ring to the nearest other one; [`LONE_SPACING_RAD`] of a single ring.
fn spacings_rad(sensor: &Sensor) -> Vec<f64> {
    let mut order: Vec<usize> = (0..sensor.rings().len()).collect();
    let elevation = |ring: usize| sensor.rings()[ring].elevation_rad;
    order.sort_unstable_by(|a, b| elevation(*a).total_cmp(&elevation(*b)));
    let mut spacings = vec![LONE_SPACING_RAD; order.len()];
    let mut nearest = vec![f64::INFINITY; order.len()];
    for pair in order.windows(2) {
        let gap = elevation(pair[1]) - elevation(pair[0]);
        for ring in pair {
            nearest[*ring] = nearest[*ring].min(gap);
        }
    }
    for (spacing, nearest) in spacings.iter_mut().zip(nearest) {
        if nearest.is_finite() {
            *spacing = nearest;
        }
    }
    spacings
}
