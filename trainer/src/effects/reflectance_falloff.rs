//! Reflectance that is not corrected for range: air takes its part of the light, and near targets are out of the receiver's focus.

use super::{About, ActsOn, Channel, Effect, Evidence, Image, Parameter, Values};

/// I·η(r)·e^{−2βr} with the overlap η(r) = 1 − e^{−(r/r₀)ⁿ} of the laser's beam and the receiver's view, n = 2 for a Gaussian beam. The 1/r² of
/// the laser equation is in reflectance as sensors report it already.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReflectanceFalloff;

impl Effect for ReflectanceFalloff {
    fn about(&self) -> About {
        About {
            name: "reflectance_falloff",
            does: "reports reflectance that fades with range, by e^−2·{beta_per_m} a metre, and is too dark nearer than {overlap_m}",
            channel: Channel::Reflectance,
            acts_on: ActsOn::REFLECTANCE,
            covariates: &["range"],
            formula: "I·(1 − e^{−(r/r₀)ⁿ})·e^{−2βr}",
            source: "Höfle and Pfeifer, Correction of Laser Scanning Intensity Data (ISPRS Journal, 2007); overlap: Fang et al., Intensity Correction of Terrestrial Laser Scanning Data (IEEE TGRS, 2015)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::free("beta_per_m", 0.002, (-0.05, 0.2)),
            Parameter::positive("overlap_m", 1.0, (1e-2, 50.0)),
            Parameter::positive("overlap_exponent", 2.0, (0.3, 10.0)),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let range_m = image.surface.range_m.clone();
        let faded = (range_m.clone() * values.one(0) * -2.0).clamp(-20.0, 20.0).exp();
        let part = ((range_m.clamp_min(1e-2) / values.one(1)).log() * values.one(2)).clamp(-20.0, 3.7).exp();
        let overlap = (part * -1.0).exp() * -1.0 + 1.0;
        image.report.reflectance = image.report.reflectance * faded * overlap;
        image
    }

    /// The overlap is flat where it is far below the nearest range: guess it from the median ratio in bins of range.
    fn starts(&self, evidence: &Evidence) -> Vec<Vec<f64>> {
        let bins = ratios(evidence);
        let fit = |(overlap_m, exponent): (f64, f64)| {
            // Least squares of ln(ratio / η) = −2βr, every bin weighing the root of its pixels.
            let rest = |b: &Bin| b.ratio.ln() - (1.0 - (-(b.range_m / overlap_m).powf(exponent)).exp()).ln();
            let (rr, rq) = bins.iter().fold((0.0, 0.0), |(rr, rq), b| {
                (rr + b.weight * b.range_m.powi(2), rq + b.weight * b.range_m * rest(b))
            });
            let beta_per_m = -0.5 * rq / rr;
            let error: f64 = bins.iter().map(|b| b.weight * (rest(b) + 2.0 * beta_per_m * b.range_m).powi(2)).sum();
            (error, vec![beta_per_m, overlap_m, exponent])
        };
        if bins.len() < 3 {
            return vec![];
        }
        let overlaps = (0..12).flat_map(|i| [2.0, 1.0].map(|exponent| (0.6 * 1.4_f64.powi(i), exponent)));
        overlaps.map(fit).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, start)| start).into_iter().collect()
    }
}

/// Measured over predicted reflectance at a range.
struct Bin {
    range_m: f64,
    ratio: f64,
    weight: f64,
}

fn ratios(evidence: &Evidence) -> Vec<Bin> {
    let mut bins: Vec<Vec<f32>> = vec![vec![]; 40];
    for (i, range_m) in evidence.range_m.iter().enumerate() {
        let (predicted, measured) = (evidence.reflectance[i], evidence.measured_reflectance[i]);
        if *range_m > 0.5 && evidence.measured_range_m[i] > 0.0 && predicted > 0.05 {
            // Four bins an octave, from half a metre on.
            let bin = ((range_m / 0.5).log2() * 4.0) as usize;
            bins[bin.min(39)].push(measured / predicted);
        }
    }
    let middle = |n: usize| 0.5 * 2.0_f64.powf((n as f64 + 0.5) / 4.0);
    let bin = |(n, ratios): (usize, Vec<f32>)| {
        let weight = (ratios.len() as f64).sqrt();
        Evidence::quantile(ratios, 0.5).filter(|r| weight > 4.0 && *r > 0.01).map(|ratio| Bin {
            range_m: middle(n),
            ratio,
            weight,
        })
    };
    bins.into_iter().enumerate().filter_map(bin).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_fading_and_overlap() {
        for truth in [[0.004, 5.0, 2.0], [0.015, 3.5, 1.0], [0.0, 8.0, 2.0]] {
            Trial::of(Arc::new(ReflectanceFalloff), &truth).each_within(&[5e-4, 0.5, 0.2]);
        }
    }

    #[test]
    fn fading_is_found_where_there_is_no_overlap() {
        let trial = Trial::of(Arc::new(ReflectanceFalloff), &[0.005, 0.2, 2.0]);
        assert!((trial.found[0] - 0.005).abs() < 3e-4, "{:?}", trial.found);
        assert!(trial.found[1] < 2.5, "{:?}", trial.found);
    }
}
