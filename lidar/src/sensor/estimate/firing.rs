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
    let firings: Vec<Bits> = beams.iter().zip(rings).map(|(beam, ring)| fired(beam, ring, columns)).collect();
    let Some(reference) = (0..firings.len()).max_by_key(|ring| firings[*ring].count()) else { return };
    if firings[reference].count() * 10 > columns * 9 {
        return;
    }
    // Twice over, so that a turned row is a slice.
    let pattern = firings[reference].twice(columns);
    for (ring, fit) in fits.iter_mut().enumerate() {
        let fired = &firings[ring];
        let (mut best, mut second) = ((0, 0), 0);
        for shift in 0..columns {
            let hits = fired.shared(&pattern, shift);
            if hits > best.0 {
                second = best.0;
                best = (hits, shift);
            } else {
                second = second.max(hits);
            }
        }
        let share = |hits: usize| hits as f64 / fired.count().max(1) as f64;
        if share(best.0) >= LEAST_SHARE && share(best.0) - share(second) >= LEAST_LEAD {
            // Column c of this ring fired with column c + shift of the reference, which lies that many columns to the right.
            let shift = if best.1 * 2 > columns { best.1 as f64 - columns as f64 } else { best.1 as f64 };
            let within = rings[ring].azimuth_offset_rad - rings[reference].azimuth_offset_rad;
            fit.firing_offset_rad = Some(shift * TAU / columns as f64 + within);
        }
    }
}

/// A row of columns, each fired at or not, 64 a word.
struct Bits(Vec<u64>);

impl Bits {
    fn none(columns: usize) -> Self {
        Self(vec![0; columns.div_ceil(64)])
    }

    fn set(&mut self, column: usize) {
        self.0[column / 64] |= 1 << (column % 64);
    }

    fn has(&self, column: usize) -> bool {
        self.0[column / 64] >> (column % 64) & 1 == 1
    }

    fn count(&self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// The row and once more the row behind it, with words to spare.
    fn twice(&self, columns: usize) -> Self {
        let mut twice = Self::none(2 * columns + 128);
        for column in (0..columns).filter(|column| self.has(*column)) {
            twice.set(column);
            twice.set(column + columns);
        }
        twice
    }

    /// Columns c that this row has and `pattern` has at c + shift.
    fn shared(&self, pattern: &Self, shift: usize) -> usize {
        let (word, bit) = (shift / 64, shift % 64);
        // Two shifts, for one by 64 is none.
        let turned = pattern.0[word..].windows(2).map(|pair| pair[0] >> bit | pair[1] << 1 << (63 - bit));
        self.0.iter().zip(turned).map(|(a, b)| (a & b).count_ones() as usize).sum()
    }
}

/// Columns in which the ring has a point in the first scan.
fn fired(beam: &Beam, ring: &Ring, columns: usize) -> Bits {
    let mut fired = Bits::none(columns);
    for i in 0..beam.ends.first().copied().unwrap_or(0) {
        let encoder = beam.azimuth_rad[i] - ring.azimuth_offset_rad - beside_rad(ring.lateral_m, beam.away_m[i]);
        fired.set(in_column(encoder, columns).1);
    }
    fired
}
