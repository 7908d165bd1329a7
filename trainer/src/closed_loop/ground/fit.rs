//! Linear fits that a few wrong rows do not spoil.

use nalgebra::{SMatrix, SVector};

/// Rounds of reweighting; each brings the fit several times closer.
const ROUNDS: usize = 25;

/// The first coefficient of y ≈ row·c and its standard error, by iteratively reweighted least squares with Cauchy's weights
/// 1/(1 + (e/scale)²) (Huber, Robust Statistics, 1981).
pub(super) fn robust<const N: usize>(rows: &[[f64; N]], y: &[f64], scale: f64) -> Option<(f64, f64)> {
    let mut weights = vec![1.0; y.len()];
    let mut found = None;
    for _ in 0..ROUNDS {
        let (mut products, mut sums) = (SMatrix::<f64, N, N>::zeros(), SVector::<f64, N>::zeros());
        for ((row, y), w) in rows.iter().zip(y).zip(&weights) {
            let row = SVector::from(*row);
            products += row * row.transpose() * *w;
            sums += row * (y * w);
        }
        let inverse = products.try_inverse()?;
        let c = inverse * sums;
        let mut squares = 0.0;
        for ((row, y), w) in rows.iter().zip(y).zip(&mut weights) {
            let e = y - SVector::from(*row).dot(&c);
            squares += *w * e * e;
            *w = 1.0 / (1.0 + (e / scale).powi(2));
        }
        let total: f64 = weights.iter().sum();
        found = Some((c[0], (inverse[(0, 0)] * squares / (total - N as f64).max(1.0)).sqrt()));
    }
    found.filter(|(c, error)| c.is_finite() && error.is_finite() && *error > 0.0)
}
