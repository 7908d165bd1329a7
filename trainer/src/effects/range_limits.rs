//! Nothing nearer than one range or farther than another.

use burn::tensor::Tensor;

use super::draw::cumulative;
use super::{About, ActsOn, Channel, Effect, Evidence, Image, Parameter, Values};

/// keep · P(r₁ ≤ r ≤ r₂), r being the range with its noise.
#[derive(Clone, Copy, Debug)]
pub(super) struct RangeLimits;

/// Softness of the cuts beside the range noise, in m: a cut through an image is as sharp as its pixels are fine.
const SOFT_M: f64 = 0.05;

/// Share of strays that a cut may leave on its wrong side.
const STRAYS: f64 = 0.02;

impl Effect for RangeLimits {
    fn about(&self) -> About {
        About {
            name: "range_limits",
            does: "reports nothing nearer than {minimum_m} m or farther than {maximum_m} m",
            channel: Channel::Missing,
            acts_on: ActsOn::RETURNS,
            covariates: &["range"],
            formula: "keep · Φ((r − r₁)/σ) · Φ((r₂ − r)/σ)",
            source: "blind zone and maximum range as in data sheets: Velodyne, HDL-64E S2 manual, 0.9 m and 120 m",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::free("minimum_m", 0.2, (0.0, 50.0)),
            Parameter::free("maximum_m", 0.2, (2.0, 1000.0)).from(500.0),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let report = &mut image.report;
        let sigma_m = (report.range_sigma_m.clone().square() + SOFT_M * SOFT_M).sqrt();
        let beyond = |x: Tensor<3>| cumulative(&(x / sigma_m.clone()));
        let inside = beyond(report.range_m.clone() - values.one(0)) * beyond(values.one(1) - report.range_m.clone());
        report.keep = report.keep.clone() * inside;
        image
    }

    fn starts(&self, evidence: &Evidence) -> Vec<Vec<f64>> {
        let mut hit: Vec<usize> = evidence.pixels().filter(|i| evidence.range_m[*i] > 0.0).collect();
        hit.sort_unstable_by(|a, b| evidence.range_m[*a].total_cmp(&evidence.range_m[*b]));
        let minimum = cut(evidence, hit.iter());
        let maximum = cut(evidence, hit.iter().rev());
        minimum.zip(maximum).map(|(from, to)| vec![from, to]).into_iter().collect()
    }
}

/// The range up to which it is likeliest that nothing is reported, the pixels being in the order in which a moving cut loses them.
fn cut<'a>(evidence: &Evidence, pixels: impl Iterator<Item = &'a usize>) -> Option<f64> {
    let (mut gain, mut best, mut at) = (0.0, 0.0, None);
    for i in pixels {
        let range_m = f64::from(evidence.range_m[*i]);
        let p = f64::from(evidence.reported[*i]).clamp(1e-3, 1.0 - 1e-3);
        gain += if evidence.returned(*i) { (STRAYS / p).ln() } else { ((1.0 - STRAYS) / (1.0 - p)).ln() };
        at = at.or(Some(range_m));
        if gain > best {
            (best, at) = (gain, Some(range_m));
        }
    }
    at
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_both_cuts() {
        Trial::of(Arc::new(RangeLimits), &[5.3, 24.0]).each_within(&[0.05, 0.2]);
    }
}
