//! Maximum mean discrepancy (Gretton et al., "A kernel two-sample test", 2012), from tables of a kernel, and the kernel distance of features.

use rayon::prelude::*;

use crate::metric::Metric;

/// Of a network's features.
pub const KID: Metric = Metric {
    name: "KID",
    unit: "",
    definition: "square of the maximum mean discrepancy, unbiased, of the segmentation network's features with the kernel (x·y/d + 1)³ (Bińkowski \
                 et al. 2018); a sample is an eighth of a turn, pairs within one scan are left out; may be below 0",
};

/// A kernel between the scans of one set and those of another.
#[derive(Clone, Debug)]
pub struct Table {
    columns: usize,
    values: Vec<f64>,
}

impl Table {
    /// The kernel of (row, column), computed in parallel.
    pub fn new(rows: usize, columns: usize, kernel: impl Fn(usize, usize) -> f64 + Sync) -> Self {
        let values = (0..rows * columns).into_par_iter().map(|i| kernel(i / columns, i % columns)).collect();
        Self { columns, values }
    }

    /// The kernel of a row's and a column's scan.
    pub fn at(&self, row: usize, column: usize) -> f64 {
        self.values[row * self.columns + column]
    }
}

/// Mean within a + mean within b − 2·mean between them, for the scans `a` and `b` of tables [within a, within b, between]: biased, for every
/// scan is compared with itself too.
pub fn discrepancy([aa, bb, ab]: [&Table; 3], a: &[usize], b: &[usize]) -> f64 {
    let mean = |table: &Table, a: &[usize], b: &[usize]| {
        a.iter().map(|i| b.iter().map(|j| table.at(*i, *j)).sum::<f64>()).sum::<f64>() / (a.len() * b.len()) as f64
    };
    mean(aa, a, a) + mean(bb, b, b) - 2.0 * mean(ab, a, b)
}

/// The same without pairs of a scan with itself: unbiased. NaN where a set has no two scans.
pub fn unbiased_discrepancy([aa, bb, ab]: [&Table; 3], a: &[usize], b: &[usize]) -> f64 {
    let within = |table: &Table, of: &[usize]| {
        let (mut sum, mut pairs) = (0.0, 0usize);
        for i in of {
            for j in of.iter().filter(|j| *j != i) {
                sum += table.at(*i, *j);
                pairs += 1;
            }
        }
        sum / pairs as f64
    };
    let between =
        a.iter().map(|i| b.iter().map(|j| ab.at(*i, *j)).sum::<f64>()).sum::<f64>() / (a.len() * b.len()) as f64;
    within(aa, a) + within(bb, b) - 2.0 * between
}

/// Mean of (x·y/d + 1)³ over the pairs of two scans' samples, d being their length: Bińkowski et al., "Demystifying MMD GANs" (2018).
pub fn polynomial(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    let one = |x: &[f64], y: &[f64]| {
        let product: f64 = x.iter().zip(y).map(|(x, y)| x * y).sum();
        (product / x.len() as f64 + 1.0).powi(3)
    };
    a.iter().map(|x| b.iter().map(|y| one(x, y)).sum::<f64>()).sum::<f64>() / (a.len() * b.len()) as f64
}

/// The three tables of [`polynomial`] that a discrepancy needs; a set is scans, a scan is samples.
pub fn polynomial_tables(a: &[&[Vec<f64>]], b: &[&[Vec<f64>]]) -> [Table; 3] {
    let table = |a: &[&[Vec<f64>]], b: &[&[Vec<f64>]]| Table::new(a.len(), b.len(), |i, j| polynomial(a[i], b[j]));
    [table(a, a), table(b, b), table(a, b)]
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::frechet::tests::wave;

    fn kid(a: &[Vec<Vec<f64>>], b: &[Vec<Vec<f64>>]) -> f64 {
        fn borrow(set: &[Vec<Vec<f64>>]) -> Vec<&[Vec<f64>]> {
            set.iter().map(Vec::as_slice).collect()
        }
        let [aa, bb, ab] = polynomial_tables(&borrow(a), &borrow(b));
        let all = |n: usize| (0..n).collect::<Vec<usize>>();
        unbiased_discrepancy([&aa, &bb, &ab], &all(a.len()), &all(b.len()))
    }

    // numpy, with one sample a scan, as in the paper: k = lambda x, y: (x@y.T/4 + 1)**3; K, L, M = k(a, a), k(b, b), k(a, b);
    // (K.sum() - K.trace())/(12*11) + (L.sum() - L.trace())/(9*8) - 2*M.mean(), with a, b = wave(12, 0), wave(9, .5)
    #[test]
    fn with_one_sample_a_scan_it_is_the_papers_estimator() {
        let scans = |samples: Vec<Vec<f64>>| samples.into_iter().map(|s| vec![s]).collect::<Vec<_>>();
        let found = kid(&scans(wave(12, 0.0)), &scans(wave(9, 0.5)));
        assert!((found - 7.555_326_953_403).abs() < 1e-9, "{found}");
    }

    // Scans whose samples are much alike, all from one distribution: an estimator that compared samples of one scan would be far above 0.
    #[test]
    fn samples_of_one_scan_may_be_alike_without_a_bias() {
        use rand_distr_free::normal;
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let mut set = || -> Vec<Vec<Vec<f64>>> {
            (0..6)
                .map(|_| {
                    let centre = normal(&mut rng);
                    vec![vec![centre]; 4]
                })
                .collect()
        };
        let values: Vec<f64> = (0..400).map(|_| kid(&set(), &set())).collect();
        let mean = values.iter().sum::<f64>() / 400.0;
        let error = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 400.0 / 400.0).sqrt();
        assert!(mean.abs() < 3.0 * error, "{mean} ± {error}");
    }

    /// A normal number without another crate: the sum of twelve uniform ones less 6 has variance 1.
    mod rand_distr_free {
        use rand::{Rng, RngExt};

        pub(super) fn normal(rng: &mut impl Rng) -> f64 {
            (0..12).map(|_| rng.random_range(0.0..1.0f64)).sum::<f64>() - 6.0
        }
    }
}
