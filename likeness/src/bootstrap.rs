//! How sure a score is: scans drawn again and again, with replacement (Efron 1979).

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// How often scans are drawn again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draws {
    /// Draws; 0 = no interval.
    pub count: usize,
    /// Seed.
    pub seed: u64,
}

impl Default for Draws {
    fn default() -> Self {
        Self { count: 200, seed: 1 }
    }
}

/// A value with its interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resampled {
    /// Of all scans.
    pub value: f64,
    /// From the 2.5th to the 97.5th percentile of the draws.
    pub ci95: Option<[f64; 2]>,
}

impl Draws {
    /// A statistic of two sets of scans, told by their indices: of all, and of scans of each set drawn with replacement.
    pub fn of_two(self, sizes: [usize; 2], statistic: impl Fn(&[usize], &[usize]) -> f64 + Sync) -> Resampled {
        let all = sizes.map(|n| (0..n).collect::<Vec<usize>>());
        let value = statistic(&all[0], &all[1]);
        let mut drawn: Vec<f64> = (0..self.count)
            .into_par_iter()
            .map(|k| {
                let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
                rng.set_stream(k as u64);
                let [a, b] = sizes.map(|n| (0..n).map(|_| rng.random_range(0..n)).collect::<Vec<usize>>());
                statistic(&a, &b)
            })
            .filter(|x| x.is_finite())
            .collect();
        drawn.sort_by(f64::total_cmp);
        let at = |share: f64| drawn[(share * (drawn.len() - 1) as f64).round() as usize];
        Resampled { value, ci95: (!drawn.is_empty()).then(|| [at(0.025), at(0.975)]) }
    }

    /// A statistic of one set.
    pub fn of_one(self, size: usize, statistic: impl Fn(&[usize]) -> f64 + Sync) -> Resampled {
        self.of_two([size, 1], |a, _| statistic(a))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_of_a_mean_is_two_standard_errors_either_way() {
        // 100 numbers of variance 1/12: standard error 0.0289.
        let numbers: Vec<f64> = (0..100).map(|i| (f64::from(i) + 0.5) / 100.0).collect();
        let mean = |of: &[usize]| of.iter().map(|i| numbers[*i]).sum::<f64>() / of.len() as f64;
        let found = Draws { count: 2000, seed: 3 }.of_one(100, mean);
        let ci95 = found.ci95.unwrap_or_default();
        assert!((found.value - 0.5).abs() < 1e-12);
        // 2000 draws know a percentile of a normal distribution to a twentieth of its standard deviation.
        assert!((ci95[1] - ci95[0] - 2.0 * 1.96 * 0.0289).abs() < 0.01, "{ci95:?}");
        assert_eq!(Draws { count: 0, seed: 3 }.of_one(100, mean).ci95, None);
    }
}
