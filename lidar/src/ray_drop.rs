//! Ray drop: which rays the sensor reports, decided by a counter-based generator.
//!
//! Every number is a word of the `ChaCha8` key stream: the key is the seed, the stream is (channel, ring), the word's position is the
//! column. A ray's number therefore depends on (seed, channel, ring, column) alone, never on batch, order or threads.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

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

/// Decides each ray: `keep[i]` becomes true where u < `probability[i]`. Shapes `[ring, column]`; `scratch` holds u afterwards.
pub fn sample(seed: u64, columns: usize, probability: &[f32], scratch: &mut Vec<f32>, keep: &mut Vec<bool>) {
    scratch.resize(probability.len(), 0.0);
    uniform(seed, 0, columns, scratch);
    keep.clear();
    keep.extend(scratch.iter().zip(probability).map(|(u, p)| u < p));
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

    #[test]
    fn certain_rays_are_certain() {
        let (mut u, mut keep) = (Vec::new(), Vec::new());
        sample(7, 512, &[1.0; 1024], &mut u, &mut keep);
        assert!(keep.iter().all(|k| *k));
        sample(7, 512, &[0.0; 1024], &mut u, &mut keep);
        assert!(keep.iter().all(|k| !*k));
    }

    #[test]
    fn the_kept_share_is_the_probability() {
        let (mut u, mut keep) = (Vec::new(), Vec::new());
        sample(3, 2048, &vec![0.3; 64 * 2048], &mut u, &mut keep);
        let share = keep.iter().filter(|k| **k).count() as f64 / keep.len() as f64;
        // Standard deviation √(0.3·0.7/131072) = 0.0013; five of them.
        assert!((share - 0.3).abs() < 0.0063, "{share}");
    }
}
