//! Which ring each point of a cloud belongs to: by the cloud's own ring field, by the order of its points, or by elevation.

use std::f64::consts::PI;

use serde::Serialize;

use crate::cloud::PointCloud;
use crate::sensor::Sensor;

/// How a cloud's rings were told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RingSource {
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

/// A sensor's table from elevation to ring.
#[derive(Clone, Debug)]
pub(crate) struct Rings {
    elevation_rad: Vec<f64>,
    /// Ring by slot of the tangent of elevation, from `tan_min` on, `slots_per_unit` apart.
    table: Vec<u16>,
    tan_min: f32,
    slots_per_unit: f32,
}

const SLOTS: usize = 1 << 14;

impl Rings {
    pub(crate) fn new(sensor: &Sensor) -> Self {
        let elevation_rad: Vec<f64> = sensor.rings().iter().map(|r| r.elevation_rad).collect();
        let mut order: Vec<usize> = (0..elevation_rad.len()).collect();
        order.sort_by(|a, b| elevation_rad[*a].total_cmp(&elevation_rad[*b]));
        let sorted: Vec<f64> = order.iter().map(|i| elevation_rad[*i]).collect();
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
                order[nearest] as u16
            })
            .collect();
        let slots_per_unit = (SLOTS as f64 / (tan_max - tan_min)) as f32;
        Self { elevation_rad, table, tan_min: tan_min as f32, slots_per_unit }
    }

    /// Fills `rows` with the ring of each point, [`NO_RING`] where none sees it.
    pub(crate) fn assign(&self, cloud: &PointCloud, rows: &mut Vec<u16>) -> RingSource {
        if self.assign_by_field(cloud, rows) {
            RingSource::Field
        } else if self.assign_by_order(cloud, rows) {
            RingSource::Order
        } else {
            self.assign_by_elevation(cloud, rows);
            RingSource::Elevation
        }
    }

    fn assign_by_elevation(&self, cloud: &PointCloud, rows: &mut Vec<u16>) {
        rows.clear();
        rows.extend((0..cloud.len()).map(|i| {
            let (x, y, z) = (cloud.x[i], cloud.y[i], cloud.z[i]);
            let slot = (z / (x * x + y * y).sqrt() - self.tan_min) * self.slots_per_unit;
            if slot >= 0.0 && slot < SLOTS as f32 { self.table[slot as usize] } else { NO_RING }
        }));
    }

    /// Takes the cloud's ring field in the numbering that fits the sensor's elevations: as it is, bottom up, or by rank of elevation.
    fn assign_by_field(&self, cloud: &PointCloud, rows: &mut Vec<u16>) -> bool {
        let Some(field) = &cloud.ring else { return false };
        let rings = self.elevation_rad.len();
        let Some(means) = mean_elevations(cloud, field, rings) else { return false };
        let seen: Vec<usize> = (0..rings).filter(|r| means[*r].is_some()).collect();
        if seen.is_empty() {
            return false;
        }
        let mut ranked = seen.clone();
        ranked.sort_by(|a, b| means[*b].unwrap_or(0.0).total_cmp(&means[*a].unwrap_or(0.0)));
        let mut by_rank = vec![NO_RING; rings];
        if seen.len() == rings {
            let mut order: Vec<usize> = (0..rings).collect();
            order.sort_by(|a, b| self.elevation_rad[*b].total_cmp(&self.elevation_rad[*a]));
            for (rank, ring) in ranked.iter().enumerate() {
                by_rank[*ring] = order[rank] as u16;
            }
        }
        let as_is: Vec<u16> = (0..rings as u16).collect();
        let bottom_up: Vec<u16> = (0..rings as u16).rev().collect();
        let misfit = |map: &[u16]| -> f64 {
            let total: f64 = seen
                .iter()
                .map(|r| {
                    let target = self.elevation_rad.get(usize::from(map[*r])).copied().unwrap_or(PI);
                    (means[*r].unwrap_or(0.0) - target).abs()
                })
                .sum();
            total / seen.len() as f64
        };
        let candidates = [as_is, bottom_up, by_rank];
        let Some(best) = candidates.iter().min_by(|a, b| misfit(a).total_cmp(&misfit(b))) else { return false };
        // A mounting or calibration that is off by a degree or two is still this sensor; a field that means something else is not.
        if misfit(best) > 2.5f64.to_radians() {
            return false;
        }
        rows.clear();
        rows.extend(field.iter().map(|r| best[usize::from(*r)]));
        true
    }

    /// KITTI's order: beam by beam, top beam first, each from straight ahead counter-clockwise; a new beam begins where the azimuth
    /// wraps from 360° to 0°. Taken only if it gives exactly the sensor's rings, from top to bottom.
    fn assign_by_order(&self, cloud: &PointCloud, rows: &mut Vec<u16>) -> bool {
        let rings = self.elevation_rad.len();
        if cloud.len() < rings * 16 || self.elevation_rad.windows(2).any(|w| w[0] <= w[1]) {
            return false;
        }
        rows.clear();
        let mut row = 0usize;
        let mut previous_ahead_left = true;
        for i in 0..cloud.len() {
            let (x, y) = (cloud.x[i], cloud.y[i]);
            // In front of the sensor, crossing from its right (y < 0) to its left (y ≥ 0).
            let left = y >= 0.0;
            if x > 0.0 && left && !previous_ahead_left {
                row += 1;
                if row >= rings {
                    return false;
                }
            }
            previous_ahead_left = left || x <= 0.0 && previous_ahead_left && left;
            rows.push(row as u16);
        }
        if row + 1 != rings {
            return false;
        }
        let Some(means) = mean_elevations(cloud, rows, rings) else { return false };
        let misfit: f64 =
            means.iter().zip(&self.elevation_rad).map(|(m, e)| m.map_or(PI, |m| (m - e).abs())).sum::<f64>()
                / rings as f64;
        misfit < 2.5f64.to_radians()
    }
}

/// Mean elevation of each ring's finite points; `None` if a ring is not below `rings`.
fn mean_elevations(cloud: &PointCloud, ring: &[u16], rings: usize) -> Option<Vec<Option<f64>>> {
    let mut sums = vec![(0.0f64, 0usize); rings];
    for (i, ring) in ring.iter().enumerate() {
        let sum = sums.get_mut(usize::from(*ring))?;
        let (x, y, z) = (cloud.x[i], cloud.y[i], cloud.z[i]);
        let tangent = z / (x * x + y * y).sqrt();
        if tangent.is_finite() {
            sum.0 += f64::from(tangent);
            sum.1 += 1;
        }
    }
    Some(sums.into_iter().map(|(sum, n)| (n > 0).then(|| (sum / n as f64).atan())).collect())
}
