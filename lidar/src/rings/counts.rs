//! Rings by how many points each has, as whoever simulated the scan says.

use super::Rings;
use crate::projection::ProjectionError;

impl Rings {
    /// Takes the points ring after ring, from the highest to the lowest, so many each.
    pub(super) fn assign_by_counts(&self, counts: &[u32], rows: &mut [u16]) -> Result<(), ProjectionError> {
        let (found, rings) = (counts.len(), self.top_down.len());
        if found != rings {
            return Err(ProjectionError::OtherRings { found, rings });
        }
        let (counted, points) = (counts.iter().map(|count| u64::from(*count)).sum(), rows.len());
        if counted != points as u64 {
            return Err(ProjectionError::OtherPoints { counted, points });
        }
        let mut rest = rows;
        for (count, ring) in counts.iter().zip(&self.top_down) {
            let (ours, after) = rest.split_at_mut(*count as usize);
            ours.fill(*ring);
            rest = after;
        }
        Ok(())
    }
}
