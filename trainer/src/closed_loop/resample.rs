//! A bootstrap over blocks: which are drawn how often, once, so that everything that is compared is compared on the same draws.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::outcome::Interval;

/// Draws of a bootstrap.
const DRAWS: usize = 1000;

/// A bootstrap: how often each draw has each block.
#[derive(Clone, Debug)]
pub struct Bootstrap {
    draws: Vec<Vec<f64>>,
    blocks: usize,
}

impl Bootstrap {
    /// A bootstrap over so many blocks.
    pub fn new(blocks: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let draws = (0..DRAWS)
            .map(|_| {
                let mut times = vec![0.0; blocks];
                (0..blocks).for_each(|_| times[rng.random_range(0..blocks)] += 1.0);
                times
            })
            .collect();
        Self { draws, blocks }
    }

    /// What `statistic` says of all blocks, and its 95 % percentile interval over the draws; its argument is each block's weight.
    pub fn interval(&self, statistic: impl Fn(&[f64]) -> f64) -> Interval {
        let mut drawn: Vec<f64> = self.draws.iter().map(|times| statistic(times)).filter(|x| x.is_finite()).collect();
        drawn.sort_by(f64::total_cmp);
        let at = |q: f64| drawn.get((drawn.len().saturating_sub(1) as f64 * q).round() as usize).copied();
        let value = statistic(&vec![1.0; self.blocks]);
        Interval { value, ci95: [at(0.025).unwrap_or(f64::NAN), at(0.975).unwrap_or(f64::NAN)] }
    }

    /// Sum of `above` over sum of `below`, with its interval.
    pub fn ratio(&self, above: &[f64], below: &[f64]) -> Interval {
        self.interval(|times| weighted(times, above) / weighted(times, below))
    }
}

/// Σ times·of.
pub(crate) fn weighted(times: &[f64], of: &[f64]) -> f64 {
    times.iter().zip(of).map(|(t, x)| t * x).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_of_a_mean_is_two_standard_errors_wide() {
        let values: Vec<f64> = (0..100).map(|i| f64::from(i % 10)).collect();
        let found = Bootstrap::new(100, 1).ratio(&values, &[1.0; 100]);
        // Standard deviation 2.87 over √100; a thousand draws know their quantiles to 5 %.
        assert!((found.value - 4.5).abs() < 1e-12);
        assert!((found.ci95[1] - found.ci95[0] - 2.0 * 1.96 * 0.287).abs() < 0.1, "{found:?}");
    }
}
