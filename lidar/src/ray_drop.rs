//! Ray drop: which rays the sensor reports, decided by a counter-based generator.
//!
//! Every number is a word of the `ChaCha8` key stream: the key is the seed, the stream is (channel, ring), the word's position is the
//! column. A ray's number therefore depends on (seed, channel, ring, column) alone, never on batch, order or threads. Where rays are lost
//! in [`Bursts`], a ray may take over the number of the one beside it, which is as little a matter of chance.

mod bursts;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::range_image::RangeImage;

pub use bursts::{Burst, Bursts, BurstsError, MAX_BURSTS};

/// Decides ray drop; channels 1… are the model's `noise` input.
const DROP: u32 = 0;

/// Decides which rays take over another's number; far beyond the channels of any model.
const TAKE_OVER: u32 = u32::MAX;

/// Fills `out` (`[ring, column]`, row-major) with independent uniform numbers in [0, 1), multiples of 2⁻²⁴.
///
/// Channel 0 decides ray drop; channels 1… are the model's `noise` input.
pub fn uniform(seed: u64, channel: u32, columns: usize, out: &mut [f32]) {
    let key = ChaCha8Rng::seed_from_u64(seed);
    let mut bytes = vec![0; 4 * columns.min(out.len())];
    for (ring, row) in out.chunks_mut(columns.max(1)).enumerate() {
        let mut words = key.clone();
        words.set_stream((u64::from(channel) << 32) | ring as u64);
        let bytes = &mut bytes[..4 * row.len()];
        words.fill_bytes(bytes);
        for (value, word) in row.iter_mut().zip(bytes.as_chunks().0) {
            *value = (u32::from_le_bytes(*word) >> 8) as f32 / (1u32 << 24) as f32;
        }
    }
}

/// Decides which rays are reported; keeps its memory from scan to scan.
#[derive(Clone, Debug, Default)]
pub struct RayDrop {
    bursts: Bursts,
    column_deg: f64,
    numbers: Vec<f32>,
    taken_over: Vec<f32>,
}

impl RayDrop {
    /// Rays are lost in these bursts; neighbouring columns lie `column_deg` apart.
    pub fn new(bursts: Bursts, column_deg: f64) -> Self {
        Self { bursts, column_deg, ..Self::default() }
    }

    /// Decides each ray of a simulated scan: `keep[i]` becomes true where u < `probability[i]`, both `[ring, column]`. Rays that have a
    /// return in the simulation share their u in bursts; what a sensor reports without one is decided ray by ray.
    pub fn sample(&mut self, seed: u64, simulated: &RangeImage, probability: &[f32], keep: &mut Vec<bool>) {
        let columns = simulated.columns();
        self.numbers.resize(probability.len(), 0.0);
        uniform(seed, DROP, columns, &mut self.numbers);
        if !self.bursts.is_empty() {
            self.taken_over.resize(probability.len(), 0.0);
            uniform(seed, TAKE_OVER, columns, &mut self.taken_over);
            self.bursts.share(columns, self.column_deg, simulated.range_m(), &self.taken_over, &mut self.numbers);
        }
        keep.clear();
        keep.extend(self.numbers.iter().zip(probability).map(|(u, p)| u < p));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rays_number_does_not_depend_on_how_many_rays_there_are() {
        let (mut small, mut large) = (vec![0.0; 2 * 100], vec![0.0; 5 * 100]);
        uniform(42, 0, 100, &mut small);
        uniform(42, 0, 100, &mut large);
        assert_eq!(small, large[..200]);
    }

    #[test]
    fn seeds_channels_and_rings_are_independent() {
        let draw = |seed, channel| {
            let mut out = vec![0.0; 2 * 4096];
            uniform(seed, channel, 4096, &mut out);
            out
        };
        let base = draw(1, 0);
        let correlation = |a: &[f32], b: &[f32]| {
            a.iter().zip(b).map(|(a, b)| f64::from(a - 0.5) * f64::from(b - 0.5) * 12.0).sum::<f64>() / a.len() as f64
        };
        // The correlation of n independent pairs has a standard deviation of 1/√n = 0.011 (0.016 for one ring).
        assert!(correlation(&base, &draw(2, 0)).abs() < 0.06);
        assert!(correlation(&base, &draw(1, 1)).abs() < 0.06);
        assert!(correlation(&base[..4096], &base[4096..]).abs() < 0.08);
        assert!((correlation(&base, &base) - 1.0).abs() < 0.05);
    }

    /// Rays that all hit something.
    fn wall(rings: usize, columns: usize) -> RangeImage {
        let pixels = rings * columns;
        RangeImage::from_channels(columns, vec![9.0; pixels], vec![0.5; pixels], vec![0; pixels])
    }

    fn kept(bursts: Bursts, probability: f32, simulated: &RangeImage, seed: u64) -> Vec<bool> {
        let mut keep = Vec::new();
        let column_deg = 360.0 / simulated.columns() as f64;
        RayDrop::new(bursts, column_deg).sample(
            seed,
            simulated,
            &vec![probability; simulated.range_m().len()],
            &mut keep,
        );
        keep
    }

    fn two_lengths() -> Result<Bursts, BurstsError> {
        Bursts::new(vec![Burst { share: 0.3, azimuth_deg: 0.4 }, Burst { share: 0.2, azimuth_deg: 6.0 }])
    }

    #[test]
    fn certain_rays_are_certain() -> Result<(), BurstsError> {
        for bursts in [Bursts::default(), two_lengths()?] {
            assert!(kept(bursts.clone(), 1.0, &wall(2, 512), 7).iter().all(|k| *k));
            assert!(kept(bursts, 0.0, &wall(2, 512), 7).iter().all(|k| !*k));
        }
        Ok(())
    }

    #[test]
    fn the_kept_share_is_the_probability() -> Result<(), BurstsError> {
        // Standard deviation √(0.3·0.7/131072) = 0.0013; in bursts of 0.3 · 2.3 + 0.2 · 34 columns to either side four times as much. Five of them.
        for (bursts, tolerance) in [(Bursts::default(), 0.0063), (two_lengths()?, 0.026)] {
            let keep = kept(bursts, 0.3, &wall(64, 2048), 3);
            let share = keep.iter().filter(|k| **k).count() as f64 / keep.len() as f64;
            assert!((share - 0.3).abs() < tolerance, "{share}");
        }
        Ok(())
    }

    #[test]
    fn rays_are_lost_together_as_often_as_the_bursts_say() -> Result<(), BurstsError> {
        let (rings, columns, lost) = (512, 1800, 0.1);
        let keep = kept(two_lengths()?, 1.0 - lost as f32, &wall(rings, columns), 11);
        for lag in [1, 2, 5, 30, 120] {
            let pairs = keep.chunks(columns).flat_map(|row| row.iter().zip(&row[lag..]));
            let both = pairs.filter(|(a, b)| !**a && !**b).count() as f64 / (rings * (columns - lag)) as f64;
            let together = (both - lost * lost) / (lost - lost * lost);
            let expected = two_lengths()?.together(0.2 * lag as f64);
            assert!((together - expected).abs() < 0.012, "{lag}: {together}, expected {expected}");
        }
        // Nothing hangs together from ring to ring.
        let pairs = keep.iter().zip(&keep[columns..]);
        let both = pairs.filter(|(a, b)| !**a && !**b).count() as f64 / ((rings - 1) * columns) as f64;
        assert!((both - lost * lost).abs() < 0.001, "{both}");
        Ok(())
    }

    #[test]
    fn a_rays_fate_depends_on_no_ring_below() -> Result<(), BurstsError> {
        let (small, large) = (kept(two_lengths()?, 0.8, &wall(2, 256), 5), kept(two_lengths()?, 0.8, &wall(5, 256), 5));
        assert_eq!(small, large[..512]);
        Ok(())
    }

    #[test]
    fn rays_without_a_simulated_return_are_decided_one_by_one() -> Result<(), BurstsError> {
        let mut simulated = wall(4, 1024);
        (0..2048).for_each(|i| simulated.remove(i));
        let (alone, shared) = (kept(Bursts::default(), 0.5, &simulated, 9), kept(two_lengths()?, 0.5, &simulated, 9));
        assert_eq!(alone[..2048], shared[..2048]);
        assert_ne!(alone[2048..], shared[2048..]);
        Ok(())
    }
}
