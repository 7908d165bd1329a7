//! How fast something grows, whatever single measurements do: the slope of Theil and Sen.

/// Samples are taken together in so many blocks at most: neighbours are no independent witnesses, and the number of pairs of a day of
/// samples would be large.
const BLOCKS: usize = 40;

/// Samples in a block, at least, where there are enough.
const IN_A_BLOCK: usize = 3;

/// Least number of blocks: with fewer no interval of 95 % is any use.
const FEWEST: usize = 8;

/// The median of the slopes of all pairs, with its 95 % interval from the distribution of Kendall's τ (P. K. Sen, Estimates of the
/// Regression Coefficient Based on Kendall's Tau, 1968).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slope {
    pub(crate) low: f64,
    pub(crate) middle: f64,
    pub(crate) high: f64,
}

impl Slope {
    /// Of samples (x, y) in the order of x; `None` where there are too few.
    pub(crate) fn of(samples: &[(f64, f64)]) -> Option<Self> {
        let length = samples.len().div_ceil(BLOCKS).max(IN_A_BLOCK);
        let middle = |values: Vec<f64>| crate::figures::median(&values);
        let blocks: Vec<(f64, f64)> = samples
            .chunks_exact(length)
            .map(|block| (middle(block.iter().map(|s| s.0).collect()), middle(block.iter().map(|s| s.1).collect())))
            .collect();
        if blocks.len() < FEWEST {
            return None;
        }
        let pairs = (0..blocks.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
        let mut slopes: Vec<f64> =
            pairs.map(|(j, i)| (blocks[i].1 - blocks[j].1) / (blocks[i].0 - blocks[j].0)).collect();
        slopes.sort_by(f64::total_cmp);
        // Standard deviation of concordant minus discordant pairs where there is no trend.
        let n = blocks.len() as f64;
        let half = 1.96 * (n * (n - 1.0) * (2.0 * n + 5.0) / 18.0).sqrt() / 2.0;
        let centre = slopes.len() as f64 / 2.0;
        let at = |place: f64| slopes[(place.max(0.0) as usize).min(slopes.len() - 1)];
        Some(Self { low: at((centre - half).floor()), middle: at(centre), high: at((centre + half).ceil()) })
    }
}

#[cfg(test)]
mod tests {
    use lidar::ray_drop::uniform;

    use super::*;

    /// Samples that grow by so much an hour for ten minutes, with noise of ±100,000 and a jump.
    fn samples(growth: f64, seed: u64) -> Vec<(f64, f64)> {
        let mut noise = vec![0.0; 120];
        uniform(seed, 0, 120, &mut noise);
        let at = |i: usize| i as f64 * 5.0 / 3600.0;
        let value = |i: usize| 1e8 + growth * at(i) + (f64::from(noise[i]) - 0.5) * 2e5;
        (0..120).map(|i| (at(i), value(i) + if i == 60 { 1e7 } else { 0.0 })).collect()
    }

    #[test]
    fn the_interval_holds_the_growth_and_one_wild_sample_does_not_move_it() -> Result<(), &'static str> {
        let mut covered = 0;
        for seed in 0..200 {
            let slope = Slope::of(&samples(3e6, seed)).ok_or("too few")?;
            assert!(slope.low < slope.middle && slope.middle < slope.high && slope.high - slope.low < 2e6, "{slope:?}");
            covered += usize::from(slope.low < 3e6 && 3e6 < slope.high);
        }
        // 190 are expected; five standard deviations of √(200 · 0.95 · 0.05) = 3.1.
        assert!(covered > 174, "{covered} of 200");
        assert!(Slope::of(&samples(0.0, 1)[..20]).is_none());
        Ok(())
    }
}
