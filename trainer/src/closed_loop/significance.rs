//! How sure a gain is: blocks of rays, scenes, and the normal distribution.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::outcome::Interval;

/// Resamplings of a bootstrap.
const RESAMPLINGS: usize = 1000;

/// A sum over the rays of one block: a sector of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Scene that the block belongs to.
    pub scene: usize,
    /// The sum.
    pub sum: f64,
}

/// Mean a ray with its 95 % interval, from a block bootstrap over scenes; within a scene too where there are fewer than five.
pub fn interval(blocks: &[Block], rays: f64, seed: u64) -> Interval {
    let mut scenes: Vec<usize> = blocks.iter().map(|b| b.scene).collect();
    scenes.sort_unstable();
    scenes.dedup();
    let whole: Vec<f64> = if scenes.len() >= 5 {
        scenes.iter().map(|s| blocks.iter().filter(|b| b.scene == *s).map(|b| b.sum).sum()).collect()
    } else {
        blocks.iter().map(|b| b.sum).collect()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let n = whole.len();
    let mut sums: Vec<f64> =
        (0..RESAMPLINGS).map(|_| (0..n).map(|_| whole[rng.random_range(0..n)]).sum::<f64>() / rays).collect();
    sums.sort_by(f64::total_cmp);
    let at = |q: f64| sums.get(((RESAMPLINGS - 1) as f64 * q) as usize).copied().unwrap_or(f64::NAN);
    Interval { value: whole.iter().sum::<f64>() / rays, ci95: [at(0.025), at(0.975)] }
}

/// Probability of a mean at least this far above 0 where the true mean is 0: a one-sided z-test over blocks.
pub fn p_value(blocks: &[Block]) -> f64 {
    let n = blocks.len() as f64;
    let mean = blocks.iter().map(|b| b.sum).sum::<f64>() / n;
    let variance = blocks.iter().map(|b| (b.sum - mean).powi(2)).sum::<f64>() / (n - 1.0);
    if variance <= 0.0 {
        return if mean > 0.0 { 0.0 } else { 1.0 };
    }
    normal_tail(mean / (variance / n).sqrt())
}

/// Probability that a standard normal number exceeds `z`, to a relative error of 1.2e-7.
///
/// Chebyshev fit of the complementary error function: Press et al., Numerical Recipes (1992), `erfcc`.
pub fn normal_tail(z: f64) -> f64 {
    const FIT: [f64; 10] = [
        0.170_872_77,
        -0.822_152_23,
        1.488_515_87,
        -1.135_203_98,
        0.278_868_07,
        -0.186_288_06,
        0.096_784_18,
        0.374_091_96,
        1.000_023_68,
        -1.265_512_23,
    ];
    let x = z.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.5 * x);
    let polynomial = FIT.iter().fold(0.0, |sum, c| sum * t + c);
    let tail = 0.5 * t * (-x * x + polynomial).exp();
    if z >= 0.0 { tail } else { 1.0 - tail }
}

/// Probabilities adjusted so that claiming all below q makes at most the share q of the claims false (Benjamini and Hochberg 1995).
pub fn benjamini_hochberg(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).collect();
    order.sort_by(|a, b| p[*a].total_cmp(&p[*b]));
    let mut adjusted = vec![1.0; p.len()];
    let mut least: f64 = 1.0;
    for (rank, i) in order.iter().enumerate().rev() {
        least = least.min(p[*i] * p.len() as f64 / (rank + 1) as f64);
        adjusted[*i] = least;
    }
    adjusted
}

/// How much wider than a normal one the 95 % interval of Student's distribution with so many degrees of freedom is.
///
/// Cornish and Fisher's expansion: Abramowitz and Stegun, Handbook of Mathematical Functions (1964), 26.7.5; to 2 % from 4 degrees on.
pub fn few_scenes(freedom: f64) -> f64 {
    let z = 1.96_f64;
    let first = (z.powi(3) + z) / 4.0;
    let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
    (z + first / freedom + second / freedom.powi(2)) / z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_of_the_normal_distribution() {
        for (z, p) in [(0.0, 0.5), (1.644_853_6, 0.05), (-1.0, 0.841_344_7), (6.0, 9.865_876e-10)] {
            assert!((normal_tail(z) / p - 1.0).abs() < 1e-5, "{z}: {} for {p}", normal_tail(z));
        }
    }

    #[test]
    fn adjusted_probabilities_keep_their_order() {
        let adjusted = benjamini_hochberg(&[0.01, 0.5, 0.02, 0.04]);
        for (found, expected) in adjusted.iter().zip([0.04, 0.5, 0.04, 0.053_333]) {
            assert!((found - expected).abs() < 1e-5, "{adjusted:?}");
        }
    }

    #[test]
    fn blocks_that_agree_are_sure_and_blocks_that_do_not_are_not() {
        let blocks = |sums: &[f64]| -> Vec<Block> {
            sums.iter().enumerate().map(|(i, sum)| Block { scene: i / 2, sum: *sum }).collect()
        };
        assert!(p_value(&blocks(&[1.0, 1.2, 0.9, 1.1])) < 1e-6);
        assert!(p_value(&blocks(&[1.0, -1.2, 0.9, -1.1])) > 0.4);
        let interval = interval(&blocks(&[1.0, 1.2, 0.9, 1.1]), 4.0, 1);
        assert!(
            (interval.value - 1.05).abs() < 1e-9 && interval.ci95[0] > 0.85 && interval.ci95[1] < 1.25,
            "{interval:?}"
        );
    }

    #[test]
    fn few_scenes_want_wider_intervals() {
        for (freedom, t) in [(4.0, 2.776), (6.0, 2.447), (13.0, 2.160), (1e6, 1.960)] {
            assert!((few_scenes(freedom) * 1.96 / t - 1.0).abs() < 0.02, "{freedom}");
        }
    }
}
