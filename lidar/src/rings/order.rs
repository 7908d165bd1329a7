//! Rings by the order of the points: beam by beam, as KITTI stores them.

#![allow(
    clippy::inline_always,
    reason = "a loop is compiled for the processor at hand only where all of it is inlined"
)]

use pulp::Arch;

use super::{MAX_MISFIT_RAD, Rings};
use crate::cloud::PointCloud;

/// A step back in azimuth that begins a new ring, in turns, in the order in which they are tried: half a turn is KITTI's own wrap;
/// a twelfth also tells rings that lack the sector before or after the wrap, and still none of the steps back of up to 7° that
/// motion compensation leaves within a ring.
pub(crate) const BACK_TURNS: [f32; 2] = [0.5, 1.0 / 12.0];

/// A step ahead that undoes the ring's beginning just before it: the azimuth went back over the wrap.
const AHEAD_TURNS: f32 = 0.9;

/// Within so many points of its beginning a ring may be undone.
const JITTER_POINTS: usize = 16;

/// Every how manyth point is looked at for the rings' mean elevations.
const STRIDE: usize = 3;

impl Rings {
    /// KITTI's order: beam by beam, top beam first, each from straight ahead counter-clockwise; a new ring where the azimuth falls.
    ///
    /// Taken if it gives the sensor's rings from top to bottom. If it gives a few more or fewer, because a ring is missing or was cut
    /// in two, rings are told by the steps between their mean elevations; that rare path alone allocates.
    pub(super) fn assign_by_order(
        &mut self,
        cloud: &PointCloud,
        turns: &[f32],
        range_m: &[f32],
        rows: &mut [u16],
    ) -> bool {
        let rings = self.elevation_rad.len();
        if cloud.len() < rings * 16 || self.elevation_rad.windows(2).any(|w| w[0] <= w[1]) {
            return false;
        }
        let most = rings + rings / 8 + 1;
        for back_turns in BACK_TURNS {
            let Some(found) = number_rings(turns, range_m, back_turns, most, rows) else { return false };
            if found * 2 < rings {
                return false;
            }
            if found == rings {
                self.means.take(cloud, self.pivot, rows, rings, STRIDE);
                let fits = self.means.descend() && self.misfit_rad(|ring| ring) <= MAX_MISFIT_RAD;
                if fits && self.beams_change_where_rows_do(cloud, rows) {
                    return true;
                }
            }
        }
        let Some(found) = number_rings(turns, range_m, BACK_TURNS[1], most, rows) else { return false };
        if found + rings / 8 < rings {
            return false;
        }
        self.means.take(cloud, self.pivot, rows, found, 1);
        let Some(ring_of_segment) = align(&self.means.elevation_rad, &self.elevation_rad) else { return false };
        if self.misfit_rad(|segment| ring_of_segment[segment]) > MAX_MISFIT_RAD {
            return false;
        }
        for row in rows.iter_mut() {
            *row = ring_of_segment[usize::from(*row)] as u16;
        }
        self.beams_change_where_rows_do(cloud, rows)
    }

    /// True if most rows begin with the step down to the next beam. Rings that are listed one by one but from elsewhere than straight
    /// ahead have wraps too, as many as they are, but in the midst of a beam.
    fn beams_change_where_rows_do(&self, cloud: &PointCloud, rows: &[u16]) -> bool {
        let (mut changes, mut steps_down) = (0, 0);
        let tangent = |i: usize| f64::from(self.pivot.tangent(cloud.x[i], cloud.y[i], cloud.z[i]));
        for i in 1..rows.len() {
            let (above, below) = (usize::from(rows[i - 1]), usize::from(rows[i]));
            if above < below {
                changes += 1;
                let expected_rad = self.elevation_rad[above] - self.elevation_rad[below];
                steps_down += u32::from(tangent(i - 1).atan() - tangent(i).atan() > 0.5 * expected_rad);
            }
        }
        steps_down * 2 > changes
    }
}

/// Numbers the rings of a cloud that lists them one after the other, each counter-clockwise: a new one where the azimuth falls by more
/// than `back_turns`. Returns how many there are, `None` past `most`. Points without a range belong to the ring before them.
pub(crate) fn number_rings(
    turns: &[f32],
    range_m: &[f32],
    back_turns: f32,
    most: usize,
    rows: &mut [u16],
) -> Option<usize> {
    // Nearly every block of points lies within a ring, and that is told without looking at them one by one.
    const BLOCK: usize = 64;
    let (mut row, mut begun_at, mut highest) = (0usize, 0usize, 0usize);
    let mut previous = 0.0f32;
    for (block, rows) in rows.chunks_mut(BLOCK).enumerate() {
        let start = block * BLOCK;
        let range_m = &range_m[start..start + rows.len()];
        if start > 0 && advances(&turns[start - 1..start + rows.len()], range_m, back_turns) {
            rows.fill(row as u16);
            previous = ahead(turns[start + rows.len() - 1]);
            continue;
        }
        for (k, row_of_point) in rows.iter_mut().enumerate() {
            let i = start + k;
            if range_m[k] > 0.0 && range_m[k].is_finite() {
                let step = ahead(turns[i]) - previous;
                if step < -back_turns {
                    row += 1;
                    begun_at = i;
                    highest = highest.max(row);
                    if highest >= most {
                        return None;
                    }
                } else if step > AHEAD_TURNS && row > 0 && i - begun_at < JITTER_POINTS {
                    row -= 1;
                }
                previous = ahead(turns[i]);
            }
            *row_of_point = row as u16;
        }
    }
    Some(highest + 1)
}

/// True if every point has a range and none ends its ring; `turns` begins with the point before the first.
fn advances(turns: &[f32], range_m: &[f32], back_turns: f32) -> bool {
    Arch::new().dispatch(
        #[inline(always)]
        || {
            let mut outside = 0u32;
            for ((&before, &turn), &range) in turns.iter().zip(&turns[1..]).zip(range_m) {
                let step = ahead(turn) - ahead(before);
                let ends = step < -back_turns || step > AHEAD_TURNS;
                let measured = range > 0.0 && range < f32::INFINITY;
                outside |= u32::from(ends) | u32::from(!measured);
            }
            outside == 0
        },
    )
}

/// Azimuth from straight ahead, counter-clockwise, 0 to 1. A y that was rounded to −0 is the end of a ring, not the next one's beginning.
#[inline(always)]
fn ahead(turns: f32) -> f32 {
    if turns.is_sign_negative() { turns + 1.0 } else { turns }
}

impl super::Means {
    /// True if nearly every ring lies below the one before it, as it must in this order; a shuffled cloud's do not.
    fn descend(&self) -> bool {
        let falls = self.elevation_rad.windows(2).filter(|w| matches!(w, [Some(a), Some(b)] if b < a)).count();
        falls * 8 >= (self.elevation_rad.len() - 1) * 7
    }
}

/// The ring of each segment, never going up, by dynamic programming: the steps between the segments' elevations fit the steps between
/// their rings' best, whatever the sensor's tilt or height does to them all. Two segments in succession may be one ring cut in two.
fn align(segments: &[Option<f64>], rings: &[f64]) -> Option<Vec<usize>> {
    const MOST_SKIPPED: usize = 8;
    let segments: Vec<f64> = segments.iter().copied().collect::<Option<_>>()?;
    // The absolute fit only decides what the steps leave open: which end lacks a ring.
    let misfit = |segment: usize, ring: usize| 0.01 * (segments[segment] - rings[ring]).powi(2);
    let mut cost: Vec<f64> = (0..rings.len()).map(|ring| misfit(0, ring)).collect();
    let mut from = vec![vec![0usize; rings.len()]];
    for segment in 1..segments.len() {
        let step = segments[segment] - segments[segment - 1];
        let mut next = vec![f64::INFINITY; rings.len()];
        let mut back = vec![0; rings.len()];
        for ring in 0..rings.len() {
            for previous in ring.saturating_sub(MOST_SKIPPED)..=ring {
                let total = cost[previous] + (step - (rings[ring] - rings[previous])).powi(2) + misfit(segment, ring);
                if total < next[ring] {
                    (next[ring], back[ring]) = (total, previous);
                }
            }
        }
        cost = next;
        from.push(back);
    }
    let mut ring = (0..rings.len()).min_by(|a, b| cost[*a].total_cmp(&cost[*b]))?;
    let mut path = vec![ring; segments.len()];
    for segment in (1..segments.len()).rev() {
        ring = from[segment][ring];
        path[segment - 1] = ring;
    }
    Some(path)
}
