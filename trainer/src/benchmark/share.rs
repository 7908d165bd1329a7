//! So many of so many, and what that says of the share.

/// So many of so many.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Share {
    /// How many are.
    pub yes: usize,
    /// Of how many.
    pub of: usize,
}

impl Share {
    /// Counts.
    pub fn count(all: impl IntoIterator<Item = bool>) -> Self {
        all.into_iter().fold(Self::default(), |s, yes| Self { yes: s.yes + usize::from(yes), of: s.of + 1 })
    }

    /// The share; NaN of none.
    pub fn value(self) -> f64 {
        self.yes as f64 / self.of as f64
    }

    /// Wilson's 95 % interval of the share.
    pub fn wilson95(self) -> [f64; 2] {
        const Z: f64 = 1.959_963_984_540_054;
        let (p, n) = (self.value(), self.of as f64);
        let middle = (p + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
        let half = Z / (1.0 + Z * Z / n) * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        [(middle - half).max(0.0), (middle + half).min(1.0)]
    }
}

impl std::fmt::Display for Share {
    /// `95 % (19 of 20, 76–99 %)`; a dash of none.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.of == 0 {
            return f.write_str("–");
        }
        let [low, high] = self.wilson95().map(|x| 100.0 * x);
        write!(f, "{:.0} % ({} of {}, {low:.0}–{high:.0} %)", 100.0 * self.value(), self.yes, self.of)
    }
}

/// The size at which the share `level` is found, from the counts at each size in rising order; none if it is not reached, or is passed
/// already at the smallest.
pub fn size_found(curve: &[(f64, Share)], level: f64) -> Option<f64> {
    let rising = isotonic(&curve.iter().map(|(_, share)| (share.value(), share.of as f64)).collect::<Vec<_>>());
    let at = (1..rising.len()).find(|i| rising[*i - 1] < level && rising[*i] >= level)?;
    let (before, after) = (curve[at - 1].0.ln(), curve[at].0.ln());
    let way = (level - rising[at - 1]) / (rising[at] - rising[at - 1]);
    Some((before + way * (after - before)).exp())
}

/// The closest values that never fall, in weighted least squares: neighbours that do are pooled (Ayer et al. 1955).
fn isotonic(values: &[(f64, f64)]) -> Vec<f64> {
    let mut pools: Vec<(f64, f64, usize)> = Vec::new();
    for (value, weight) in values {
        let mut pool = (*value, *weight, 1);
        while let Some((v, w, n)) = pools.pop_if(|(v, ..)| *v >= pool.0) {
            pool = ((v * w + pool.0 * pool.1) / (w + pool.1), w + pool.1, n + pool.2);
        }
        pools.push(pool);
    }
    pools.into_iter().flat_map(|(value, _, n)| std::iter::repeat_n(value, n)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilsons_interval_is_the_textbooks() {
        // 8 of 10 at 95 %: 0.4902 to 0.9433 (Agresti and Coull 1998 print 0.490 and 0.943).
        let [low, high] = Share { yes: 8, of: 10 }.wilson95();
        assert!((low - 0.4902).abs() < 1e-4 && (high - 0.9433).abs() < 1e-4, "{low} to {high}");
        assert!((Share { yes: 10, of: 10 }.wilson95()[1] - 1.0).abs() < 1e-12);
        assert_eq!(Share { yes: 19, of: 20 }.to_string(), "95 % (19 of 20, 76–99 %)");
    }

    #[test]
    fn the_size_at_which_half_are_found_lies_between_sizes_on_the_logarithm() {
        let of = |yes| Share { yes, of: 10 };
        let curve = [(0.25, of(0)), (0.5, of(2)), (1.0, of(8)), (2.0, of(10))];
        let half = size_found(&curve, 0.5).unwrap_or(f64::NAN);
        assert!((half - 0.5_f64.sqrt()).abs() < 1e-9, "{half}");
        assert_eq!(size_found(&curve[..2], 0.5), None);
        // A curve that falls by chance is levelled: 0.5 at both middle sizes.
        let dented = [(0.25, of(0)), (0.5, of(6)), (1.0, of(4)), (2.0, of(10))];
        assert!((size_found(&dented, 0.5).unwrap_or(f64::NAN) - 0.5).abs() < 1e-9);
    }
}
