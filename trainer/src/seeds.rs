//! What several seeds came to.

use crate::realness::report::short;

/// Mean ± half the width of its 95 % interval, where there is more than one value.
pub(crate) fn mean_with_interval(values: &[f64]) -> String {
    match mean_and_interval(values) {
        (mean, Some(half_width)) => format!("{} ± {}", short(mean), short(half_width)),
        (mean, None) => short(mean),
    }
}

/// Which seeds these were, and what stands beside their means.
pub(crate) fn said(seeds: &[u64]) -> String {
    let interval = if seeds.len() > 1 { ", ± half of a 95 % interval over them (Student's t)" } else { "" };
    format!("seeds {seeds:?}{interval}")
}

/// Mean, and half the width of its 95 % interval by Student's t, where there is more than one value.
fn mean_and_interval(values: &[f64]) -> (f64, Option<f64>) {
    /// 97.5 % quantiles of Student's t with 1 to 9 degrees of freedom.
    const T: [f64; 9] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262];
    let n = values.len();
    let mean = values.iter().sum::<f64>() / n as f64;
    if n < 2 {
        return (mean, None);
    }
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1) as f64;
    // Beyond nine the normal quantile is too narrow by less than a sixth, which this makes up for.
    let t = T.get(n - 2).copied().unwrap_or(1.96 + 2.7 / (n - 1) as f64);
    (mean, Some(t * (variance / n as f64).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_is_students() {
        // Three values 1, 2, 3: 4.303 · 1/√3.
        let (mean, half_width) = mean_and_interval(&[1.0, 2.0, 3.0]);
        assert!(
            (mean - 2.0).abs() < 1e-12 && half_width.is_some_and(|w| (w - 2.4843).abs() < 1e-3),
            "{mean} {half_width:?}"
        );
        assert_eq!(mean_and_interval(&[1.0]), (1.0, None));
        assert_eq!([mean_with_interval(&[1.0, 2.0, 3.0]), mean_with_interval(&[0.25])], ["2.00 ± 2.48", "0.250"]);
    }
}
