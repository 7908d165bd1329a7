//! What one scene says of a covariate: its normal equations, within strata.
//!
//! y = a + x·θ + z·ν with one a a stratum, by least squares. The strata's constants and the nuisances ν, which are the scene's own, are eliminated;
//! what is left of a scene is a small matrix and a vector, so that any set of scenes is fitted, resampled and scored without another look
//! at its rays (Frisch and Waugh 1933).

use std::ops::Add;

use nalgebra::{DMatrix, DVector};

/// Prior precision of a coefficient relative to the scatter of y: what no scene says anything of stays 0.
const RIDGE: f64 = 1.0;

/// Column and value of what is not 0.
pub(super) type Columns = Vec<(usize, f64)>;

/// One cell as a row of the regression.
#[derive(Clone, Debug)]
pub(super) struct Row<K> {
    pub(super) stratum: K,
    pub(super) weight: f64,
    pub(super) y: f64,
    pub(super) x: Columns,
}

/// Normal equations Aθ = b of a scene.
#[derive(Clone, Debug)]
pub(super) struct Evidence {
    a: DMatrix<f64>,
    b: DVector<f64>,
    /// Weighted squares of y about the strata's means, and the sum of the weights.
    squares: f64,
    weight: f64,
}

impl Evidence {
    /// From rows, of which the last `nuisances` of the `columns` columns are the scene's own; per frame of `frames`, so that long scenes
    /// weigh no more than short ones.
    pub(super) fn new<K: Ord + Copy>(mut rows: Vec<Row<K>>, columns: usize, nuisances: usize, frames: usize) -> Self {
        rows.sort_by_key(|row| row.stratum);
        let mut sum = Self::nothing(columns);
        for stratum in rows.chunk_by(|a, b| a.stratum == b.stratum) {
            sum.add_stratum(stratum);
        }
        sum.scaled(1.0 / frames.max(1) as f64).without_last(nuisances)
    }

    fn nothing(columns: usize) -> Self {
        Self { a: DMatrix::zeros(columns, columns), b: DVector::zeros(columns), squares: 0.0, weight: 0.0 }
    }

    fn add_stratum<K>(&mut self, rows: &[Row<K>]) {
        if rows.len() < 2 {
            return;
        }
        let weight: f64 = rows.iter().map(|r| r.weight).sum();
        let mean_y = rows.iter().map(|r| r.weight * r.y).sum::<f64>() / weight;
        let mut mean_x = Columns::new();
        for row in rows {
            for (column, x) in &row.x {
                match mean_x.iter_mut().find(|(c, _)| c == column) {
                    Some((_, sum)) => *sum += row.weight * x / weight,
                    None => mean_x.push((*column, row.weight * x / weight)),
                }
            }
        }
        for Row { weight: w, y, x, .. } in rows {
            self.squares += w * (y - mean_y).powi(2);
            for (i, xi) in x {
                self.b[*i] += w * xi * (y - mean_y);
                for (j, xj) in x {
                    self.a[(*i, *j)] += w * xi * xj;
                }
            }
        }
        for (i, xi) in &mean_x {
            for (j, xj) in &mean_x {
                self.a[(*i, *j)] -= weight * xi * xj;
            }
        }
        self.weight += weight;
    }

    fn scaled(mut self, factor: f64) -> Self {
        self.a *= factor;
        self.b *= factor;
        self.squares *= factor;
        self.weight *= factor;
        self
    }

    /// The last columns eliminated, whatever their coefficients are.
    fn without_last(self, n: usize) -> Self {
        let kept = self.b.len() - n;
        let (aa, an) = (self.a.view((0, 0), (kept, kept)), self.a.view((0, kept), (kept, n)));
        let mut nn = self.a.view((kept, kept), (n, n)).into_owned();
        for i in 0..n {
            nn[(i, i)] += 1e-9 + 1e-6 * nn[(i, i)];
        }
        let Some(inverse) = nn.try_inverse() else {
            return Self { a: aa.into_owned(), b: self.b.rows(0, kept).into_owned(), ..self };
        };
        let bn = self.b.rows(kept, n).into_owned();
        let squares = self.squares - bn.dot(&(&inverse * &bn));
        let shared = an * inverse;
        Self { a: aa - &shared * an.transpose(), b: self.b.rows(0, kept) - shared * bn, squares, weight: self.weight }
    }

    /// θ of scenes together.
    pub(super) fn estimate<'a>(scenes: impl Iterator<Item = &'a Self>, columns: usize) -> DVector<f64> {
        let mut sum = scenes.fold(Self::nothing(columns), |sum, scene| sum + scene);
        for i in 0..columns {
            sum.a[(i, i)] += RIDGE;
        }
        sum.a.cholesky().map_or_else(|| DVector::zeros(columns), |a| a.solve(&sum.b))
    }

    /// Half of the squares that θ takes away.
    pub(super) fn explained(&self, theta: &DVector<f64>) -> f64 {
        self.b.dot(theta) - 0.5 * theta.dot(&(&self.a * theta))
    }

    /// Squares about the strata's means.
    pub(super) fn squares(&self) -> f64 {
        self.squares
    }

    /// Sum of the weights.
    pub(super) fn weight(&self) -> f64 {
        self.weight
    }

    /// Coefficients.
    pub(super) fn columns(&self) -> usize {
        self.b.len()
    }

    /// How much the scene says of each coefficient.
    pub(super) fn precision(&self, column: usize) -> f64 {
        self.a[(column, column)]
    }
}

impl Add<&Evidence> for Evidence {
    type Output = Self;

    fn add(mut self, other: &Self) -> Self {
        self.a += &other.a;
        self.b += &other.b;
        self.squares += other.squares;
        self.weight += other.weight;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_is_found_within_strata_whatever_their_constants_and_nuisances() {
        let row = |i: usize| {
            let (stratum, x, z) = (i % 3, (i as f64 * 0.7).sin(), (i as f64 * 1.3).cos());
            Row { stratum, weight: 1.0, y: 10.0 * stratum as f64 + 0.5 * x - 2.0 * z, x: vec![(0, x), (1, z)] }
        };
        let evidence = Evidence::new((0..3000).map(row).collect(), 2, 1, 1);
        let theta = Evidence::estimate([&evidence].into_iter(), 1);
        assert!((theta[0] - 0.5).abs() < 1e-3, "{theta}");
        assert!((evidence.squares() - 2.0 * evidence.explained(&theta)).abs() < 1e-2 * evidence.squares());
    }
}
