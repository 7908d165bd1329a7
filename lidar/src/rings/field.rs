//! Rings by the cloud's own ring field, in whichever numbering it uses.

use super::{MAX_MISFIT_RAD, NO_RING, Rings};
use crate::cloud::PointCloud;

/// Every how manyth point is looked at to tell the field's numbering; prime to every usual number of rings, so that a cloud that
/// lists its rings in turn shows them all.
const STRIDE: usize = 7;

impl Rings {
    /// Takes the cloud's ring field in the numbering that fits the sensor's elevations: as it is, bottom up, or by rank of elevation.
    /// False, with `rows` undefined, if the cloud has none or none fits.
    pub(super) fn assign_by_field(&mut self, cloud: &PointCloud, rows: &mut [u16]) -> bool {
        let Some(field) = &cloud.ring else { return false };
        let rings = self.elevation_rad.len();
        let highest = field.iter().copied().max();
        if highest.is_none_or(|ring| usize::from(ring) >= rings) {
            return false;
        }
        let all_seen = |rings: &Self| rings.means.elevation_rad.iter().all(Option::is_some);
        self.means.take(cloud, self.pivot, field, rings, STRIDE);
        if !all_seen(self) {
            self.means.take(cloud, self.pivot, field, rings, 1);
        }
        if self.means.elevation_rad.iter().all(Option::is_none) {
            return false;
        }
        self.rank();
        let as_is = self.misfit_rad(|ring| ring);
        let bottom_up = self.misfit_rad(|ring| rings - 1 - ring);
        let by_rank = if all_seen(self) { self.misfit_rad(|ring| usize::from(self.map[ring])) } else { f64::INFINITY };
        let best = as_is.min(bottom_up).min(by_rank);
        if best > MAX_MISFIT_RAD {
            return false;
        }
        // As it is wins a tie: a permutation that changes nothing in the fit has no reason.
        if as_is == best {
            self.map.clear();
            self.map.extend(0..rings as u16);
        } else if bottom_up == best {
            self.map.clear();
            self.map.extend((0..rings as u16).rev());
        }
        let map = &self.map;
        for (row, ring) in rows.iter_mut().zip(field) {
            *row = map[usize::from(*ring)];
        }
        true
    }

    /// Fills `map` with the sensor's ring of the same rank of elevation as each ring of the cloud.
    fn rank(&mut self) {
        let (means, rings) = (&mut self.means, self.elevation_rad.len());
        means.ranked.clear();
        means.ranked.extend(0..rings as u16);
        let elevation_rad = &means.elevation_rad;
        let key = |ring: u16| elevation_rad[usize::from(ring)].unwrap_or(f64::NEG_INFINITY);
        // Unstable sorting needs no memory; rings of one elevation keep their numbering.
        means.ranked.sort_unstable_by(|a, b| key(*b).total_cmp(&key(*a)).then(a.cmp(b)));
        self.map.clear();
        self.map.resize(rings, NO_RING);
        for (rank, ring) in means.ranked.iter().enumerate() {
            self.map[usize::from(*ring)] = self.top_down[rank];
        }
    }
}
