//! Scores of a predicted scan against a measured one. Weighted, so that one pixel may stand for several rays.

/// Probabilities are kept this far from 0 and 1 before their logarithm is taken: certainty that is wrong costs 6.9 nats, not infinity.
pub const PROBABILITY_MARGIN: f64 = 1e-3;

/// A binary outcome that was given a probability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forecast {
    /// Predicted probability that it is true.
    pub probability: f32,
    /// What it was.
    pub outcome: bool,
    /// Cases that it stands for.
    pub weight: f32,
}

/// Mean logarithmic loss −ln p(outcome), in nats a case; probabilities limited by [`PROBABILITY_MARGIN`]. NaN without cases.
pub fn log_loss(forecasts: &[Forecast]) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for f in forecasts {
        let p = f64::from(f.probability).clamp(PROBABILITY_MARGIN, 1.0 - PROBABILITY_MARGIN);
        sum -= f64::from(f.weight) * if f.outcome { p.ln() } else { (1.0 - p).ln() };
        weight += f64::from(f.weight);
    }
    sum / weight
}

/// Area under the receiver operating characteristic: the probability that a true case was given a higher probability than a false
/// one, ties counting half. ½ is chance. NaN without both outcomes.
pub fn auc(forecasts: &[Forecast]) -> f64 {
    let mut sorted = forecasts.to_vec();
    sorted.sort_by(|a, b| a.probability.total_cmp(&b.probability));
    let (mut below, mut area, mut trues) = (0.0, 0.0, 0.0);
    for tie in sorted.chunk_by(|a, b| a.probability == b.probability) {
        let weight = |outcome| tie.iter().filter(|f| f.outcome == outcome).map(|f| f64::from(f.weight)).sum::<f64>();
        let (t, f) = (weight(true), weight(false));
        area += t * (below + 0.5 * f);
        below += f;
        trues += t;
    }
    area / (trues * below)
}

/// Expected calibration error: mean distance between predicted probability and observed share, over `bins` equally wide bins.
pub fn calibration_error(forecasts: &[Forecast], bins: usize) -> f64 {
    let mut bin = vec![(0.0f64, 0.0f64, 0.0f64); bins];
    for f in forecasts {
        let (w, p) = (f64::from(f.weight), f64::from(f.probability));
        let b = &mut bin[((p * bins as f64) as usize).min(bins - 1)];
        b.0 += w;
        b.1 += w * p;
        b.2 += w * f64::from(u8::from(f.outcome));
    }
    let total: f64 = bin.iter().map(|b| b.0).sum();
    bin.iter().map(|b| (b.1 - b.2).abs()).sum::<f64>() / total
}

/// Mean absolute error of pairs (predicted, measured). NaN without pairs.
pub fn mean_absolute_error(pairs: impl IntoIterator<Item = (f32, f32)>) -> f64 {
    let (mut sum, mut n) = (0.0, 0usize);
    for (predicted, measured) in pairs {
        sum += f64::from((predicted - measured).abs());
        n += 1;
    }
    sum / n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn forecasts(cases: &[(f32, bool, f32)]) -> Vec<Forecast> {
        cases.iter().map(|&(probability, outcome, weight)| Forecast { probability, outcome, weight }).collect()
    }

    #[test]
    fn a_coin_costs_ln_2_and_certainty_that_is_right_almost_nothing() {
        assert!((log_loss(&forecasts(&[(0.5, true, 1.0), (0.5, false, 3.0)])) - 2f64.ln()).abs() < 1e-7);
        assert!(log_loss(&forecasts(&[(1.0, true, 1.0)])) < 0.0011);
        assert!((log_loss(&forecasts(&[(1.0, false, 1.0)])) - 6.9078).abs() < 1e-3);
    }

    #[test]
    fn auc_counts_pairs() {
        // True 0.9, 0.4; false 0.4, 0.1: pairs won 1, 1, ½, 1 of 4.
        let cases = forecasts(&[(0.9, true, 1.0), (0.4, true, 1.0), (0.4, false, 1.0), (0.1, false, 1.0)]);
        assert!((auc(&cases) - 3.5 / 4.0).abs() < 1e-12);
        assert!(auc(&forecasts(&[(0.5, true, 1.0)])).is_nan());
    }

    #[test]
    fn a_weight_of_two_is_the_case_twice() {
        let weighted = forecasts(&[(0.8, true, 2.0), (0.3, false, 1.0), (0.6, false, 1.0)]);
        let twice = forecasts(&[(0.8, true, 1.0), (0.8, true, 1.0), (0.3, false, 1.0), (0.6, false, 1.0)]);
        assert!((auc(&weighted) - auc(&twice)).abs() < 1e-12);
        assert!((log_loss(&weighted) - log_loss(&twice)).abs() < 1e-12);
    }

    #[test]
    fn a_forecast_of_60_percent_that_comes_true_half_the_time_is_off_by_10() {
        let cases = forecasts(&[(0.6, true, 1.0), (0.6, false, 1.0)]);
        assert!((calibration_error(&cases, 10) - 0.1).abs() < 1e-6);
    }
}
