//! Tables of sums over cells: fitting one on some blocks and scoring it on others needs nothing but these.

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

/// Rays at the mean that every cell is given: a cell with few rays of its own says little.
const PRIOR_RAYS: f64 = 5.0;

/// Numbers, sums and sums of squares of residuals.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cells {
    pub(super) n: Vec<f64>,
    pub(super) sum: Vec<f64>,
    pub(super) squares: f64,
}

/// A fit's score in each block, held out.
#[derive(Clone, Debug)]
pub(super) struct Scored {
    /// By how much it lowers the sum of squares about the mean.
    pub(super) gain: Vec<f64>,
    /// That sum.
    pub(super) whole: Vec<f64>,
}

impl Cells {
    pub(super) fn empty(cells: usize) -> Self {
        Self { n: vec![0.0; cells], sum: vec![0.0; cells], squares: 0.0 }
    }

    pub(super) fn add(&mut self, cell: usize, residual: f32) {
        if !residual.is_nan() {
            let y = f64::from(residual);
            self.n[cell] += 1.0;
            self.sum[cell] += y;
            self.squares += y * y;
        }
    }

    fn and(mut self, other: &Self) -> Self {
        self.n.iter_mut().zip(&other.n).for_each(|(a, b)| *a += b);
        self.sum.iter_mut().zip(&other.sum).for_each(|(a, b)| *a += b);
        self.squares += other.squares;
        self
    }

    fn mean(&self) -> f64 {
        self.sum.iter().sum::<f64>() / self.n.iter().sum::<f64>().max(1.0)
    }

    /// Σy² − Σ(y − m)², m being a number a cell.
    fn explained(&self, m: impl Iterator<Item = f64>) -> f64 {
        m.zip(&self.n).zip(&self.sum).map(|((m, n), sum)| m * (2.0 * sum - n * m)).sum()
    }
}

impl Scored {
    /// What it gains beyond another fit, where that gains anything.
    pub(super) fn beyond(mut self, other: &Self) -> Self {
        if other.gain.iter().sum::<f64>() > 0.0 {
            self.gain.iter_mut().zip(&other.gain).for_each(|(a, b)| *a -= b);
        }
        self
    }

    pub(super) fn total(&self) -> f64 {
        self.gain.iter().sum()
    }
}

/// A random half of the blocks.
pub(super) fn halves(blocks: usize, seed: u64) -> Vec<bool> {
    let mut fold: Vec<bool> = (0..blocks).map(|i| i % 2 == 0).collect();
    fold.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    fold
}

/// Fits on either half of the blocks, scores on the other.
pub(super) fn cross_validated(blocks: &[Cells], fold: &[bool], fit: &dyn Fn(&Cells) -> Vec<f64>) -> Scored {
    let fitted = [false, true].map(|half| {
        let train = train(blocks, fold, half);
        (train.mean(), fit(&train))
    });
    let score = |(block, half): (&Cells, &bool)| {
        let (mean, table) = &fitted[usize::from(!half)];
        let of_mean = block.explained(block.n.iter().map(|_| *mean));
        (block.explained(table.iter().copied()) - of_mean, block.squares - of_mean)
    };
    let (gain, whole) = blocks.iter().zip(fold).map(score).unzip();
    Scored { gain, whole }
}

/// The same of the mean itself, against no residual at all.
pub(super) fn of_the_mean(blocks: &[Cells], fold: &[bool]) -> Scored {
    let mean = [false, true].map(|half| train(blocks, fold, half).mean());
    let score = |(block, half): (&Cells, &bool)| {
        (block.explained(block.n.iter().map(|_| mean[usize::from(!half)])), block.squares)
    };
    let (gain, whole) = blocks.iter().zip(fold).map(score).unzip();
    Scored { gain, whole }
}

fn train(blocks: &[Cells], fold: &[bool], half: bool) -> Cells {
    let of = blocks.iter().zip(fold).filter(|(_, f)| **f == half);
    of.fold(Cells::empty(blocks[0].n.len()), |sum, (block, _)| sum.and(block))
}

/// The mean of each cell, drawn to the mean of all.
pub(super) fn steps(train: &Cells) -> Vec<f64> {
    let mean = train.mean();
    train.n.iter().zip(&train.sum).map(|(n, sum)| (sum + PRIOR_RAYS * mean) / (n + PRIOR_RAYS)).collect()
}

/// One number a row plus one a column of the table, by backfitting (Friedman and Stuetzle 1981).
pub(super) fn additive(train: &Cells, [rows, columns]: [usize; 2]) -> Vec<f64> {
    let mean = train.mean();
    let (mut row, mut column) = (vec![0.0; rows], vec![0.0; columns]);
    for _ in 0..10 {
        for (i, row) in row.iter_mut().enumerate() {
            let cells = (0..columns).map(|j| (i * columns + j, column[j]));
            *row = level(train, mean, cells);
        }
        for (j, column) in column.iter_mut().enumerate() {
            let cells = (0..rows).map(|i| (i * columns + j, row[i]));
            *column = level(train, mean, cells);
        }
    }
    (0..rows * columns).map(|i| mean + row[i / columns] + column[i % columns]).collect()
}

/// Mean of these cells beyond the mean of all and a number each.
fn level(train: &Cells, mean: f64, cells: impl Iterator<Item = (usize, f64)>) -> f64 {
    let (mut sum, mut n) = (0.0, PRIOR_RAYS);
    for (i, beside) in cells {
        sum += train.sum[i] - train.n[i] * (mean + beside);
        n += train.n[i];
    }
    sum / n
}

/// A straight line over the cells in their order.
pub(super) fn trend(train: &Cells) -> Vec<f64> {
    let last = (train.n.len().max(2) - 1) as f64;
    smooth(train, &|cell| vec![1.0, 2.0 * cell as f64 / last - 1.0])
}

/// The least-squares combination of some functions of the cell.
pub(super) fn smooth(train: &Cells, basis: &dyn Fn(usize) -> Vec<f64>) -> Vec<f64> {
    let rows: Vec<DVector<f64>> = (0..train.n.len()).map(|i| DVector::from_vec(basis(i))).collect();
    let size = rows[0].len();
    let mut normal = DMatrix::identity(size, size) * 1e-6;
    let mut right = DVector::zeros(size);
    for ((row, n), sum) in rows.iter().zip(&train.n).zip(&train.sum) {
        normal += row * row.transpose() * *n;
        right += row * *sum;
    }
    let weights = normal.cholesky().map_or_else(|| DVector::zeros(size), |c| c.solve(&right));
    rows.iter().map(|row| row.dot(&weights)).collect()
}
