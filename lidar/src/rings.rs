//! Which ring each point of a cloud belongs to: as its sender says, by the cloud's own ring field, by the order of
//! its points, or by elevation.

#![allow(
    clippy::inline_always,
    reason = "a loop is compiled for the processor at hand only where all of it is inlined"
)]

mod counts;
mod field;
mod order;

use std::f64::consts::PI;

use pulp::Arch;
use serde::Serialize;

use crate::cloud::PointCloud;
use crate::projection::{Polar, ProjectionError};
use crate::sensor::Sensor;
use crate::whole::whole_part;

pub(crate) use order::{BACK_TURNS, number_rings};

/// How a cloud's rings were told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RingSource {
    /// By the number of points of each ring, given beside the cloud.
    Counts,
    /// By the cloud's ring field.
    Field,
    /// By the order of the points: beam by beam, a new one where the azimuth wraps (KITTI).
    Order,
    /// By the ring whose elevation is nearest.
    #[default]
    Elevation,
}

/// Marks a point that no ring sees.
pub(crate) const NO_RING: u16 = u16::MAX;

/// A ring field or an order of points whose rings lie farther than this from the sensor's, on average, means something else.
///
/// A mounting or a calibration that is off by a degree or two is still this sensor.
const MAX_MISFIT_RAD: f64 = 2.5 * PI / 180.0;

/// A sensor's rings as a cloud's points are told apart by them, with the memory that doing so needs.
#[derive(Clone, Debug)]
pub(crate) struct Rings {
    elevation_rad: Vec<f64>,
    /// The sensor's rings from the highest to the lowest.
    top_down: Vec<u16>,
    pivot: Pivot,
    /// Ring by slot of the tangent of elevation, from `tan_min` on, `slots_per_unit` apart; past the last one [`NO_RING`].
    table: Vec<u16>,
    tan_min: f32,
    slots_per_unit: f32,
    means: Means,
    /// Ring of the sensor by ring of the cloud.
    map: Vec<u16>,
    elevation_alone: bool,
}

/// Where the rings' beams (nearly) cross: `height_m` above the origin and `behind_m` behind the spin axis.
///
/// Real sensors' beams leave the axis at heights that grow with the tangent of their elevation (HDL-64E by 0.2 m + 1.4 mm, Ouster
/// by its beam origin's 15 to 28 mm), so seen from this point, and from no other, elevation alone tells the ring.
#[derive(Clone, Copy, Debug, Default)]
struct Pivot {
    height_m: f32,
    behind_m: f32,
}

/// Mean elevation of each ring of a cloud, `None` where it has no point.
#[derive(Clone, Debug, Default)]
struct Means {
    sums: Vec<(f64, u32)>,
    elevation_rad: Vec<Option<f64>>,
    ranked: Vec<u16>,
}

const SLOTS: usize = 1 << 14;

impl Rings {
    pub(crate) fn new(sensor: &Sensor) -> Self {
        let elevation_rad: Vec<f64> = sensor.rings().iter().map(|r| r.elevation_rad).collect();
        let mut order: Vec<u16> = (0..elevation_rad.len() as u16).collect();
        order.sort_by(|a, b| elevation_rad[usize::from(*a)].total_cmp(&elevation_rad[usize::from(*b)]));
        let sorted: Vec<f64> = order.iter().map(|i| elevation_rad[usize::from(*i)]).collect();
        // A point beyond the outermost ring by more than that ring's spacing is outside the view.
        let spacing = |a: usize, b: usize| if sorted.len() > 1 { sorted[b] - sorted[a] } else { 1f64.to_radians() };
        let last = sorted.len() - 1;
        let limit = 0.49 * PI;
        let bottom = (sorted[0] - spacing(0, last.min(1))).max(-limit);
        let top = (sorted[last] + spacing(last.saturating_sub(1), last)).min(limit);
        let (tan_min, tan_max) = (bottom.tan(), top.tan());
        let table = (0..SLOTS)
            .map(|slot| {
                let elevation = (tan_min + (slot as f64 + 0.5) * (tan_max - tan_min) / SLOTS as f64).atan();
                let above = sorted.partition_point(|e| *e < elevation);
                let nearest = match above {
                    0 => 0,
                    n if n > last => last,
                    n if elevation - sorted[n - 1] < sorted[n] - elevation => n - 1,
                    n => n,
                };
                order[nearest]
            })
            .chain([NO_RING])
            .collect();
        order.reverse();
        Self {
            top_down: order,
            pivot: Pivot::of(sensor),
            table,
            tan_min: tan_min as f32,
            slots_per_unit: (SLOTS as f64 / (tan_max - tan_min)) as f32,
            means: Means::default(),
            map: Vec::with_capacity(elevation_rad.len()),
            elevation_alone: false,
            elevation_rad,
        }
    }

    pub(crate) fn use_elevation_alone(&mut self) {
        self.elevation_alone = true;
    }

    /// Fills `rows` with the ring of each point, [`NO_RING`] where none sees it. `counts` are the points of each ring, where they are known.
    pub(crate) fn assign(
        &mut self,
        cloud: &PointCloud,
        polar: &Polar,
        counts: Option<&[u32]>,
        rows: &mut Vec<u16>,
    ) -> Result<RingSource, ProjectionError> {
        rows.resize(cloud.len(), NO_RING);
        Ok(if let Some(counts) = counts {
            self.assign_by_counts(counts, rows)?;
            RingSource::Counts
        } else if !self.elevation_alone && self.assign_by_field(cloud, rows) {
            RingSource::Field
        } else if !self.elevation_alone && self.assign_by_order(cloud, &polar.turns, &polar.range_m, rows) {
            RingSource::Order
        } else {
            self.assign_by_elevation(cloud, rows);
            RingSource::Elevation
        })
    }

    /// Fills `numbers` with the number by which the cloud that was assigned last calls each of the sensor's rings: the sensor's own where
    /// its ring field did not tell.
    pub(crate) fn numbers_in_cloud(&self, source: RingSource, numbers: &mut Vec<u16>) {
        numbers.clear();
        numbers.extend(0..self.elevation_rad.len() as u16);
        if source == RingSource::Field {
            for (number, row) in self.map.iter().enumerate() {
                numbers[usize::from(*row)] = number as u16;
            }
        }
    }

    fn assign_by_elevation(&self, cloud: &PointCloud, rows: &mut [u16]) {
        let (pivot, tan_min, slots_per_unit) = (self.pivot, self.tan_min, self.slots_per_unit);
        // First each point's slot, which vectorises, then the table.
        Arch::new().dispatch(
            #[inline(always)]
            || {
                for (((row, &x), &y), &z) in rows.iter_mut().zip(&cloud.x).zip(&cloud.y).zip(&cloud.z) {
                    let slot = (pivot.tangent(x, y, z) - tan_min) * slots_per_unit;
                    let inside = slot >= 0.0 && slot < SLOTS as f32;
                    *row = if inside { whole_part(slot) as u16 } else { SLOTS as u16 };
                }
            },
        );
        let table: &[u16; SLOTS + 1] =
            self.table.as_slice().try_into().unwrap_or_else(|_| unreachable!("made that long"));
        for row in rows {
            *row = table[usize::from(*row).min(SLOTS)];
        }
    }

    /// Mean distance between the rings that `means` has and those of the sensor that `map` makes of them.
    fn misfit_rad(&self, map: impl Fn(usize) -> usize) -> f64 {
        let (mut total, mut seen) = (0.0, 0);
        for (ring, mean) in self.means.elevation_rad.iter().enumerate() {
            if let Some(mean) = mean {
                total += self.elevation_rad.get(map(ring)).map_or(PI, |target| (mean - target).abs());
                seen += 1;
            }
        }
        total / f64::from(seen)
    }
}

impl Pivot {
    /// Least squares of height = `height_m` + `behind_m` · tangent over the sensor's rings.
    fn of(sensor: &Sensor) -> Self {
        let n = sensor.rings().len() as f64;
        let mean = |value: &dyn Fn(f64, f64) -> f64| {
            sensor.rings().iter().map(|r| value(r.elevation_rad.tan(), r.height_m)).sum::<f64>() / n
        };
        let (tan, height) = (mean(&|t, _| t), mean(&|_, h| h));
        let variance = mean(&|t, _| (t - tan).powi(2));
        let slope = if variance > 1e-9 { mean(&|t, h| (t - tan) * (h - height)) / variance } else { 0.0 };
        Self { height_m: (height - slope * tan) as f32, behind_m: slope as f32 }
    }

    /// Tangent of the elevation at which the pivot sees a point.
    #[inline(always)]
    fn tangent(self, x: f32, y: f32, z: f32) -> f32 {
        (z - self.height_m) / ((x * x + y * y).sqrt() + self.behind_m)
    }
}

impl Means {
    /// Takes the mean over every `stride`-th point; false if one of them has a ring that is not below `rings`.
    fn take(&mut self, cloud: &PointCloud, pivot: Pivot, ring: &[u16], rings: usize, stride: usize) -> bool {
        self.sums.clear();
        self.sums.resize(rings, (0.0, 0));
        for i in (0..ring.len()).step_by(stride) {
            let Some(sum) = self.sums.get_mut(usize::from(ring[i])) else { return false };
            let (x, y, z) = (cloud.x[i], cloud.y[i], cloud.z[i]);
            let tangent = pivot.tangent(x, y, z);
            // A point at the origin is none, though from a pivot beside it it has an elevation.
            if tangent.is_finite() && (x != 0.0 || y != 0.0) {
                sum.0 += f64::from(tangent);
                sum.1 += 1;
            }
        }
        self.elevation_rad.clear();
        self.elevation_rad.extend(self.sums.iter().map(|(sum, n)| (*n > 0).then(|| (sum / f64::from(*n)).atan())));
        true
    }
}
