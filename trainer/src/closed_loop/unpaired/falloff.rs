//! How reflectance fades with range: what `reflectance_falloff` needs.

/// Where the overlap of beam and receiver is looked for, in m, and how steep it may be.
const OVERLAPS_M: std::ops::Range<f64> = 1.0..40.0;
const OVERLAP_STEP: f64 = 1.1;
const EXPONENTS: [f64; 6] = [0.5, 0.75, 1.0, 1.5, 2.0, 3.0];

/// η(r)·e^{−2βr}, η = 1 − e^{−(r/r₀)ⁿ}.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Falloff {
    pub(super) beta_per_m: f64,
    /// r₀ in m and n; none where near surfaces are not too dark.
    pub(super) overlap: Option<[f64; 2]>,
}

/// Measured over simulated reflectance at a range.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ratio {
    pub(super) range_m: f64,
    /// Logarithm, but for a constant.
    pub(super) log: f64,
    pub(super) variance: f64,
}

impl Falloff {
    /// ln of the factor.
    pub(super) fn log(&self, range_m: f64) -> f64 {
        let near = |[r, n]: [f64; 2]| (-(-(range_m / r).powf(n)).exp_m1()).max(1e-6).ln();
        self.overlap.map_or(0.0, near) - 2.0 * self.beta_per_m * range_m
    }

    /// Least squares, with an overlap or without; `None` if there are too few ranges.
    pub(super) fn fit(ratios: &[Ratio], with_overlap: bool) -> Option<Self> {
        if ratios.len() < if with_overlap { 5 } else { 3 } {
            return None;
        }
        if !with_overlap {
            return Some(fading(ratios, None).1);
        }
        let radii = std::iter::successors(Some(OVERLAPS_M.start), |r| Some(r * OVERLAP_STEP));
        let tried =
            radii.take_while(|r| *r < OVERLAPS_M.end).flat_map(|r| EXPONENTS.map(|n| fading(ratios, Some([r, n]))));
        tried.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, falloff)| falloff)
    }
}

/// β and the error that it leaves, with this overlap.
fn fading(ratios: &[Ratio], overlap: Option<[f64; 2]>) -> (f64, Falloff) {
    let near = Falloff { beta_per_m: 0.0, overlap };
    let mean = |of: &dyn Fn(&Ratio) -> f64| {
        let (sum, weight) = ratios.iter().fold((0.0, 0.0), |(s, w), r| (s + of(r) / r.variance, w + 1.0 / r.variance));
        sum / weight
    };
    let rest = |r: &Ratio| r.log - near.log(r.range_m);
    let (middle_m, level) = (mean(&|r| r.range_m), mean(&rest));
    let slope = mean(&|r| (r.range_m - middle_m) * (rest(r) - level)) / mean(&|r| (r.range_m - middle_m).powi(2));
    let error = mean(&|r| (rest(r) - level - slope * (r.range_m - middle_m)).powi(2));
    (error, Falloff { beta_per_m: -slope / 2.0, overlap })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fading_and_overlap_are_told_apart() {
        for truth in
            [Falloff { beta_per_m: 0.01, overlap: None }, Falloff { beta_per_m: 0.02, overlap: Some([8.0, 1.5]) }]
        {
            let ratio = |i: i32| {
                let range_m = 3.0 * 1.4_f64.powi(i);
                Ratio { range_m, log: 0.7 + truth.log(range_m), variance: 0.01 }
            };
            let found = Falloff::fit(&(0..10).map(ratio).collect::<Vec<_>>(), truth.overlap.is_some());
            let found = found.expect("ranges enough");
            assert!((found.beta_per_m - truth.beta_per_m).abs() < 1e-3, "{found:?} for {truth:?}");
            if let (Some(found), Some(truth)) = (found.overlap, truth.overlap) {
                assert!((found[0] / truth[0] - 1.0).abs() < 0.1 && found[1] == truth[1], "{found:?} for {truth:?}");
            }
        }
    }
}
