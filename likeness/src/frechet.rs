//! Fréchet's distance of two normal distributions (Dowson and Landau 1982), of features: Heusel et al., "GANs trained by a two time-scale
//! update rule" (2017).

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use crate::metric::Metric;

/// Of a network's features.
pub const FRECHET: Metric = Metric {
    name: "Fréchet distance",
    unit: "",
    definition: "|μ − ν|² + tr(Σ + Τ − 2(ΣΤ)^½) of the segmentation network's features, 64 channels of its bottleneck averaged over all rings and an \
                 eighth of a turn; a sample is an eighth of a turn; biased upwards where scans are few",
};

/// The distance of two sets of samples, all of one length; covariances divided by n − 1. NaN where a set has no two samples.
///
/// tr (ΣΤ)^½ is taken as tr (Σ^½ Τ Σ^½)^½, whose eigenvalues are the same and whose matrix is symmetric.
pub fn frechet(a: &[&[f64]], b: &[&[f64]]) -> f64 {
    if a.len() < 2 || b.len() < 2 {
        return f64::NAN;
    }
    let ((mean_a, cov_a), (mean_b, cov_b)) = (moments(a), moments(b));
    let root = root(cov_a.clone());
    let both = SymmetricEigen::new(&root * &cov_b * &root).eigenvalues;
    let shared: f64 = both.iter().map(|x| x.max(0.0).sqrt()).sum();
    // Of nothing, rounding may leave less; `max` would take what is no number for nothing.
    ((mean_a - mean_b).norm_squared() + cov_a.trace() + cov_b.trace() - 2.0 * shared).clamp(0.0, f64::INFINITY)
}

fn moments(samples: &[&[f64]]) -> (DVector<f64>, DMatrix<f64>) {
    let rows = DMatrix::from_fn(samples.len(), samples[0].len(), |i, j| samples[i][j]);
    let mean = rows.row_mean();
    let centred = DMatrix::from_fn(rows.nrows(), rows.ncols(), |i, j| rows[(i, j)] - mean[j]);
    (mean.transpose(), centred.tr_mul(&centred) / (samples.len() - 1) as f64)
}

/// The square root of a symmetric matrix without eigenvalues below 0, but for rounding.
fn root(matrix: DMatrix<f64>) -> DMatrix<f64> {
    let eigen = SymmetricEigen::new(matrix);
    let scaled = &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues.map(|x| x.max(0.0).sqrt()));
    scaled * eigen.eigenvectors.transpose()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    // Features that have covariances: i, j = np.arange(n)[:, None], np.arange(4); np.sin(1 + i*(j + 1.7) + shift) + shift*j
    pub(crate) fn wave(count: usize, shift: f64) -> Vec<Vec<f64>> {
        let at = |i: usize, j: usize| (1.0 + i as f64 * (j as f64 + 1.7) + shift).sin() + shift * j as f64;
        (0..count).map(|i| (0..4).map(|j| at(i, j)).collect()).collect()
    }

    fn distance(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
        let borrow = |set: &'_ [Vec<f64>]| set.to_vec();
        let (a, b) = (borrow(a), borrow(b));
        frechet(&a.iter().map(Vec::as_slice).collect::<Vec<_>>(), &b.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    // scipy: a, b = wave(12, 0), wave(9, .5); S, T = np.cov(a.T), np.cov(b.T); ((a.mean(0) - b.mean(0))**2).sum() + np.trace(S + T -
    // 2*scipy.linalg.sqrtm(S@T).real)
    #[test]
    fn the_distance_is_scipys() {
        let found = distance(&wave(12, 0.0), &wave(9, 0.5));
        assert!((found - 4.059_557_559_877).abs() < 1e-8, "{found}");
        assert!(distance(&wave(12, 0.0), &wave(12, 0.0)).abs() < 1e-8);
    }

    #[test]
    fn of_the_same_samples_it_is_nothing_and_of_what_is_no_number_none() {
        let (same, mut broken) = (wave(12, 0.0), wave(12, 0.0));
        let nothing = distance(&same, &same);
        assert!((0.0..1e-9).contains(&nothing), "{nothing}");
        broken[3][1] = f64::NAN;
        assert!(distance(&broken, &same).is_nan());
    }

    #[test]
    fn along_one_axis_it_is_the_distance_of_means_and_of_deviations() {
        let a: Vec<Vec<f64>> = [-1.0, 1.0].map(|x| vec![x]).into();
        let b: Vec<Vec<f64>> = [2.0, 8.0].map(|x| vec![x]).into();
        // Means 0 and 5, deviations √2 and 3√2.
        assert!((distance(&a, &b) - (25.0 + 8.0)).abs() < 1e-9);
        assert!(distance(&a[..1], &b).is_nan());
    }
}
