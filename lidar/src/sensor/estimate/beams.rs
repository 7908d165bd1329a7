//! The points of some scans, sorted by the laser that measured them.

use crate::cloud::PointCloud;
use crate::projection::Polar;
use crate::rings::{BACK_TURNS, RingSource, number_rings};
use crate::sensor::MAX_RINGS;

use super::EstimateError;

/// A ring with fewer points is not measured.
pub(super) const MIN_POINTS: usize = 16;

/// Most rings that a spinning sensor is thought to have where the scan does not number them.
const MOST_RINGS: usize = 256;

/// Tells the ring of every point of every scan, or nothing.
type Way = fn(&[PointCloud]) -> Option<Vec<Vec<u16>>>;

/// The points of one laser.
#[derive(Clone, Debug, Default)]
pub(super) struct Beam {
    /// Distance from the spin axis.
    pub(super) away_m: Vec<f64>,
    /// Height.
    pub(super) z_m: Vec<f64>,
    /// Azimuth, −π to π.
    pub(super) azimuth_rad: Vec<f64>,
    /// Number of the beam's points up to the end of each scan.
    pub(super) ends: Vec<usize>,
}

impl Beam {
    pub(super) fn len(&self) -> usize {
        self.z_m.len()
    }

    /// Most points of one scan.
    pub(super) fn densest(&self) -> usize {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        self.ends.iter().zip(starts).map(|(end, start)| end - start).max().unwrap_or(0)
    }
}

/// Sorts the scans' points into beams, by ring field, else by order, else by elevation.
pub(super) fn sort(clouds: &[PointCloud]) -> Result<(Vec<Beam>, RingSource), EstimateError> {
    let points: usize = clouds.iter().map(PointCloud::len).sum();
    let too_few = EstimateError::TooFewPoints { points, clouds: clouds.len() };
    if points < MIN_POINTS {
        return Err(too_few);
    }
    let ways: [(RingSource, Way); 3] =
        [(RingSource::Field, by_field), (RingSource::Order, by_order), (RingSource::Elevation, by_elevation)];
    for (source, way) in ways {
        if let Some(rows) = way(clouds) {
            let beams = gather(clouds, &rows);
            return if beams.is_empty() { Err(too_few) } else { Ok((beams, source)) };
        }
    }
    Err(EstimateError::NoRings)
}

fn by_field(clouds: &[PointCloud]) -> Option<Vec<Vec<u16>>> {
    let fields: Vec<Vec<u16>> = clouds.iter().map(|cloud| cloud.ring.clone()).collect::<Option<_>>()?;
    fields.iter().flatten().all(|ring| usize::from(*ring) < MAX_RINGS).then_some(fields)
}

/// Rings that are listed one after the other, the same number in every scan.
fn by_order(clouds: &[PointCloud]) -> Option<Vec<Vec<u16>>> {
    let mut polar = Polar::default();
    let mut count = None;
    let mut all = Vec::with_capacity(clouds.len());
    for cloud in clouds {
        polar.take(cloud);
        let mut rows = vec![0; cloud.len()];
        let found = number_rings(&polar.turns, &polar.range_m, BACK_TURNS[0], MOST_RINGS, &mut rows)?;
        if found < 4 || found * MIN_POINTS > cloud.len() || *count.get_or_insert(found) != found {
            return None;
        }
        // From top to bottom, but for the jitter of near points.
        let mut sums = vec![(0.0, 0.0); found];
        for (i, row) in rows.iter().enumerate() {
            let elevation = f64::from(cloud.z[i]).atan2(f64::from(cloud.x[i]).hypot(f64::from(cloud.y[i])));
            if elevation.is_finite() {
                sums[usize::from(*row)].0 += elevation;
                sums[usize::from(*row)].1 += 1.0;
            }
        }
        let falls = sums.windows(2).filter(|w| w[1].0 / w[1].1 < w[0].0 / w[0].1).count();
        if falls * 8 < (found - 1) * 7 {
            return None;
        }
        all.push(rows);
    }
    Some(all)
}

/// Peaks in the distribution of elevations: beams are told apart so where they leave one point on the axis (simulators') and lie
/// farther apart than their points' noise.
///
/// Near points' elevations are blurred by the steps in which coordinates are stored, so they are left out if they spoil the peaks.
fn by_elevation(clouds: &[PointCloud]) -> Option<Vec<Vec<u16>>> {
    [0.0, 2.0, 5.0, 10.0].into_iter().find_map(|nearest_m| by_elevation_beyond(clouds, nearest_m))
}

fn by_elevation_beyond(clouds: &[PointCloud], nearest_m: f32) -> Option<Vec<Vec<u16>>> {
    const BIN_RAD: f32 = 0.04 * std::f32::consts::PI / 180.0;
    const BINS: usize = 4500;
    let bin = |cloud: &PointCloud, i: usize| {
        let elevation = cloud.z[i].atan2(cloud.x[i].hypot(cloud.y[i]));
        (elevation.is_finite() && cloud.range_m(i) > 0.0).then(|| ((elevation / BIN_RAD) as i32 + 2250) as usize)
    };
    let mut counts = vec![0usize; BINS];
    for cloud in clouds {
        for bin in (0..cloud.len()).filter(|i| cloud.range_m(*i) >= nearest_m).filter_map(|i| bin(cloud, i)) {
            counts[bin.min(BINS - 1)] += 1;
        }
    }
    let peaks = peaks(&counts);
    if peaks.len() < 4 || peaks.len() > MOST_RINGS {
        return None;
    }
    // Nearly all points must be near a peak: within a quarter of the way to the next one.
    let edges: Vec<usize> = peaks.windows(2).map(|w| w[0].midpoint(w[1])).collect();
    let nearest = |bin: usize| edges.partition_point(|edge| *edge < bin);
    let near = |bin: usize| {
        let ring = nearest(bin);
        let below = ring.checked_sub(1).map_or(usize::MAX, |below| peaks[ring] - peaks[below]);
        let above = peaks.get(ring + 1).map_or(usize::MAX, |above| above - peaks[ring]);
        bin.abs_diff(peaks[ring]) * 4 <= below.min(above)
    };
    let total: usize = counts.iter().sum();
    let near: usize = counts.iter().enumerate().filter(|(bin, _)| near(*bin)).map(|(_, count)| count).sum();
    if near * 10 < total * 9 {
        return None;
    }
    let row = |cloud: &PointCloud, i: usize| bin(cloud, i).map_or(0, |bin| nearest(bin) as u16);
    Some(clouds.iter().map(|cloud| (0..cloud.len()).map(|i| row(cloud, i)).collect()).collect())
}

/// Bins of the peaks that rise at least fourfold out of the valleys beside them.
fn peaks(counts: &[usize]) -> Vec<usize> {
    let mut peaks = Vec::new();
    let (mut highest, mut at, mut lowest, mut rising) = (0, 0, 0, false);
    for (bin, &count) in counts.iter().chain([&0]).enumerate() {
        if rising {
            if count > highest {
                (highest, at) = (count, bin);
            } else if count * 4 < highest {
                peaks.push(at);
                (lowest, rising) = (count, false);
            }
        } else if count > 4 * lowest && count >= MIN_POINTS {
            (highest, at, rising) = (count, bin, true);
        } else {
            lowest = lowest.min(count);
        }
    }
    peaks
}

fn gather(clouds: &[PointCloud], rows: &[Vec<u16>]) -> Vec<Beam> {
    let rings = rows.iter().flatten().max().map_or(0, |ring| usize::from(*ring) + 1);
    let mut beams = vec![Beam::default(); rings];
    for (cloud, rows) in clouds.iter().zip(rows) {
        for (i, row) in rows.iter().enumerate() {
            let (x, y, z) = (f64::from(cloud.x[i]), f64::from(cloud.y[i]), f64::from(cloud.z[i]));
            let away_m = x.hypot(y);
            if away_m > 0.0 && away_m.is_finite() && z.is_finite() {
                let beam = &mut beams[usize::from(*row)];
                beam.away_m.push(away_m);
                beam.z_m.push(z);
                beam.azimuth_rad.push(y.atan2(x));
            }
        }
        for beam in &mut beams {
            beam.ends.push(beam.z_m.len());
        }
    }
    beams.retain(|beam| beam.len() >= MIN_POINTS);
    beams
}
