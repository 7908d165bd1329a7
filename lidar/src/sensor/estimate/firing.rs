//! Which ticks the rings fire at together, from the ticks that the sensor skips.

use std::f64::consts::TAU;

use super::RingFit;
use super::beams::Beam;
use super::columns::beside_rad;
use super::in_column;
use crate::sensor::Ring;

/// Share of a ring's points that must fall on the reference's firings, and how far ahead of the second best shift that must be (three
/// standard deviations of what 2000 points scatter about a shift that is nearly right; HDL-64E leads by 0.02 to 0.05).
const LEAST_SHARE: f64 = 0.85;
const LEAST_LEAD: f64 = 0.015;

/// Sets each ring's firing offset where the pattern of skipped ticks tells it.
///
/// All rings fire at the same ticks of the encoder, each turned by its own offset; HDL-64E skips every second tick or so, out of step
/// with its turns, and where it did is the same for all its rings.
pub(super) fn offsets(beams: &[Beam], rings: &[Ring], columns: usize, fits: &mut [RingFit]) {
    let firings: Vec<Vec<bool>> = beams.iter().zip(rings).map(|(beam, ring)| fired(beam, ring, columns)).collect();
    let count = |row: &[bool]| row.iter().filter(|fired| **fired).count();
    let Some(reference) = (0..firings.len()).max_by_key(|ring| count(&firings[*ring])) else { return };
    if count(&firings[reference]) * 10 > columns * 9 {
        return;
    }
    // Twice over, so that a turned row is a slice.
    let pattern = [firings[reference].as_slice(), firings[reference].as_slice()].concat();
    for (ring, fit) in fits.iter_mut().enumerate() {
        let fired: Vec<usize> = (0..columns).filter(|column| firings[ring][*column]).collect();
        let (mut best, mut second) = ((0, 0), 0);
        for shift in 0..columns {
            let hits = fired.iter().filter(|column| pattern[**column + shift]).count();
            if hits > best.0 {
                second = best.0;
                best = (hits, shift);
            } else {
                second = second.max(hits);
            }
        }
        let share = |hits: usize| hits as f64 / fired.len().max(1) as f64;
        if share(best.0) >= LEAST_SHARE && share(best.0) - share(second) >= LEAST_LEAD {
            // Column c of this ring fired with column c + shift of the reference, which lies that many columns to the right.
            let shift = if best.1 * 2 > columns { best.1 as f64 - columns as f64 } else { best.1 as f64 };
            let within = rings[ring].azimuth_offset_rad - rings[reference].azimuth_offset_rad;
            fit.firing_offset_rad = Some(shift * TAU / columns as f64 + within);
        }
    }
}

/// Columns in which the ring has a point in the first scan.
fn fired(beam: &Beam, ring: &Ring, columns: usize) -> Vec<bool> {
    let mut fired = vec![false; columns];
    for i in 0..beam.ends.first().copied().unwrap_or(0) {
        let encoder = beam.azimuth_rad[i] - ring.azimuth_offset_rad - beside_rad(ring.lateral_m, beam.away_m[i]);
        fired[in_column(encoder, columns).1] = true;
    }
    fired
}
