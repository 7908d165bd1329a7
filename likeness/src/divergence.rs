//! The divergence of Jensen and Shannon (Lin 1991), and its two spellings that papers mix up.

/// ½·Σ p ln(p/m) + ½·Σ q ln(q/m) with m = ½(p + q), both first scaled to a sum of 1; in nats, 0 to ln 2. NaN if either sums to 0.
pub fn jensen_shannon_nats(p: &[f64], q: &[f64]) -> f64 {
    let (sum_p, sum_q) = (p.iter().sum::<f64>(), q.iter().sum::<f64>());
    let towards = |p: f64, m: f64| if p > 0.0 { p * (p / m).ln() } else { 0.0 };
    let each = p.iter().zip(q).map(|(p, q)| {
        let (p, q) = (p / sum_p, q / sum_q);
        let m = 0.5 * (p + q);
        towards(p, m) + towards(q, m)
    });
    0.5 * each.sum::<f64>()
}

/// The divergence in bits, 0 to 1: what CLS2R and `DUSty` report.
pub fn bits(p: &[f64], q: &[f64]) -> f64 {
    jensen_shannon_nats(p, q) / std::f64::consts::LN_2
}

/// The square root of the divergence in nats, 0 to 0.833: scipy's `jensenshannon`, what `LiDARGen` and R2DM report.
pub fn root_nats(p: &[f64], q: &[f64]) -> f64 {
    jensen_shannon_nats(p, q).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    // `scipy.spatial.distance.jensenshannon(p, q)`, and the same with base=2, squared.
    #[test]
    fn both_spellings_are_scipys() {
        let (p, q) = ([0.1, 0.2, 0.3, 0.4, 0.0], [3.0, 1.0, 0.0, 5.0, 1.0]);
        assert!((root_nats(&p, &q) - 0.419_607_336_593_6).abs() < 1e-9, "{}", root_nats(&p, &q));
        assert!((bits(&p, &q) - 0.254_015_773_072_8).abs() < 1e-9, "{}", bits(&p, &q));
        assert!((bits(&[1.0, 0.0], &[0.0, 2.0]) - 1.0).abs() < 1e-12);
        assert!(bits(&p, &p).abs() < 1e-12 && bits(&p, &[0.0; 5]).is_nan());
    }
}
