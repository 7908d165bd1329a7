//! Whether two halves differ in what a covariate does: held-out gain, placebo, error.
//!
//! Scenes are the observations, never rays. If the sensor does what its model says, measured scenes and simulated ones are alike, and which
//! of them are called measured is of no account: the placebo calls others so, at random (permutation test, Fisher 1935).

use nalgebra::DVector;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::evidence::Evidence;
use crate::closed_loop::outcome::Interval;
use crate::closed_loop::significance::{Block, interval};

/// Parts that are held out in turn.
const FOLDS: usize = 5;

/// Halves that the placebo makes.
const PLACEBOS: u64 = 999;

/// Resamplings of the scenes.
const RESAMPLINGS: u64 = 200;

/// One covariate in both halves, a piece of evidence a scene.
#[derive(Clone, Debug)]
pub(super) struct Halves {
    pub(super) simulated: Vec<Evidence>,
    pub(super) measured: Vec<Evidence>,
}

/// How much better each half's own coefficients predict its held-out scenes than the other half's.
#[derive(Clone, Debug)]
pub(super) struct Gain {
    /// Nats a cell.
    pub(super) nats: Interval,
    /// What 95 % of the placebos stay below, in nats a cell.
    pub(super) placebo: f64,
    /// Share of the placebos, the real halves among them, that gain as much.
    pub(super) p: f64,
    /// Half of the squares that each scene is spared.
    pub(super) by_scene: Vec<f64>,
}

/// Coefficients with their resamplings over scenes.
#[derive(Clone, Debug)]
pub(super) struct Coefficients {
    pub(super) simulated: Resampled,
    pub(super) measured: Resampled,
}

/// An estimate, and what it would be on other scenes of the same kind.
#[derive(Clone, Debug)]
pub(super) struct Resampled {
    pub(super) value: DVector<f64>,
    pub(super) draws: Vec<DVector<f64>>,
}

impl Halves {
    pub(super) fn columns(&self) -> usize {
        self.simulated.first().map_or(0, Evidence::columns)
    }

    /// The same with these scenes only.
    pub(super) fn of(&self, simulated: &[usize], measured: &[usize]) -> Self {
        let some = |all: &[Evidence], which: &[usize]| which.iter().map(|i| all[*i].clone()).collect();
        Self { simulated: some(&self.simulated, simulated), measured: some(&self.measured, measured) }
    }

    /// Gain, placebo, and probability of such a gain where the halves are alike.
    pub(super) fn gain(&self, seed: u64) -> Gain {
        let all: Vec<&Evidence> = self.simulated.iter().chain(&self.measured).collect();
        let (n, columns) = (self.simulated.len(), self.columns());
        let gains = held_out(&all, n, columns);
        let total: f64 = gains.iter().sum();
        let mut placebos: Vec<f64> = (0..PLACEBOS)
            .into_par_iter()
            .map(|k| {
                let mut shuffled = all.clone();
                shuffled.shuffle(&mut ChaCha8Rng::seed_from_u64(seed ^ (k << 20)));
                held_out(&shuffled, n, columns).iter().sum()
            })
            .collect();
        placebos.sort_by(f64::total_cmp);
        let as_good = placebos.iter().filter(|g| **g >= total).count();
        let per_cell = 1.0 / (self.variance() * all.iter().map(|e| e.weight()).sum::<f64>()).max(1e-12);
        let blocks: Vec<Block> =
            gains.iter().enumerate().map(|(scene, g)| Block { scene, sum: g * per_cell }).collect();
        Gain {
            nats: interval(&blocks, 1.0, seed),
            placebo: per_cell * placebos[placebos.len() * 95 / 100],
            p: (1 + as_good) as f64 / (1 + PLACEBOS) as f64,
            by_scene: gains,
        }
    }

    /// Scatter of a cell of weight 1 about its stratum, with each half's own coefficients.
    fn variance(&self) -> f64 {
        let (mut squares, mut weight) = (0.0, 0.0);
        for half in [&self.simulated, &self.measured] {
            let theta = Evidence::estimate(half.iter(), self.columns());
            squares += half.iter().map(|e| e.squares() - 2.0 * e.explained(&theta)).sum::<f64>();
            weight += half.iter().map(Evidence::weight).sum::<f64>();
        }
        (squares / weight.max(1e-12)).max(1e-12)
    }

    /// Each half's coefficients, with a bootstrap over its scenes.
    pub(super) fn coefficients(&self, seed: u64) -> Coefficients {
        let resampled = |half: &[Evidence], seed: u64| Resampled {
            value: Evidence::estimate(half.iter(), self.columns()),
            draws: (0..RESAMPLINGS)
                .into_par_iter()
                .map(|k| {
                    let mut dice = ChaCha8Rng::seed_from_u64(seed ^ (k << 20));
                    let drawn = (0..half.len()).map(|_| &half[dice.random_range(0..half.len())]);
                    Evidence::estimate(drawn.collect::<Vec<_>>().into_iter(), self.columns())
                })
                .collect(),
        };
        Coefficients { simulated: resampled(&self.simulated, seed), measured: resampled(&self.measured, seed + 1) }
    }

    /// Share of the measured half's squares within strata that the measured coefficients explain and the simulated ones do not.
    pub(super) fn share(&self, simulated: &DVector<f64>, measured: &DVector<f64>) -> f64 {
        let rest = |theta: &DVector<f64>| -> f64 {
            self.measured.iter().map(|e| e.squares() - 2.0 * e.explained(theta)).sum()
        };
        1.0 - rest(measured) / rest(simulated).max(1e-12)
    }

    /// Root mean square of the measured half's y within strata, less what these coefficients explain.
    pub(super) fn residual(&self, theta: &DVector<f64>) -> f64 {
        let squares: f64 = self.measured.iter().map(|e| e.squares() - 2.0 * e.explained(theta)).sum();
        (squares / self.measured.iter().map(Evidence::weight).sum::<f64>().max(1e-12)).sqrt()
    }
}

/// Half of the squares that each scene is spared by its own half's coefficients rather than the other half's, both fitted on other scenes.
/// The first `n` scenes are one half.
fn held_out(scenes: &[&Evidence], n: usize, columns: usize) -> Vec<f64> {
    let place = |i: usize| if i < n { (0, i % FOLDS) } else { (1, (i - n) % FOLDS) };
    let theta = |half: usize, fold: usize| {
        let others = scenes.iter().enumerate().filter(|(i, _)| place(*i).0 == half && place(*i).1 != fold);
        Evidence::estimate(others.map(|(_, e)| *e), columns)
    };
    let of: Vec<[DVector<f64>; 2]> = (0..FOLDS).map(|fold| [theta(0, fold), theta(1, fold)]).collect();
    let gain = |(i, e): (usize, &&Evidence)| {
        let (half, fold) = place(i);
        e.explained(&of[fold][half]) - e.explained(&of[fold][1 - half])
    };
    scenes.iter().enumerate().map(gain).collect()
}

impl Coefficients {
    /// Measured minus simulated on other scenes.
    pub(super) fn draws(&self) -> Vec<DVector<f64>> {
        self.measured.draws.iter().zip(&self.simulated.draws).map(|(m, s)| m - s).collect()
    }

    /// Measured minus simulated, with standard errors.
    pub(super) fn difference(&self) -> (DVector<f64>, DVector<f64>) {
        let value = &self.measured.value - &self.simulated.value;
        let draws = self.draws();
        let stderr = (0..value.len()).map(|i| deviation(draws.iter().map(|d| d[i])));
        let stderr = DVector::from_iterator(value.len(), stderr);
        (value, stderr)
    }
}

impl Resampled {
    /// Coefficient `i` with the 95 % interval of its resamplings, each shifted by `centre` of all coefficients.
    pub(super) fn interval(&self, i: usize, centre: &dyn Fn(&DVector<f64>) -> f64) -> Interval {
        let mut draws: Vec<f64> = self.draws.iter().map(|d| d[i] - centre(d)).collect();
        draws.sort_by(f64::total_cmp);
        let at = |q: f64| draws.get(((draws.len() - 1) as f64 * q) as usize).copied().unwrap_or(f64::NAN);
        Interval { value: self.value[i] - centre(&self.value), ci95: [at(0.025), at(0.975)] }
    }
}

/// Standard deviation.
pub(super) fn deviation(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)).sqrt()
}
