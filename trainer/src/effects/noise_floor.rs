//! What every sensor has and no report calls an effect: noise, a base rate of lost rays, and a few reports that fit nothing.

use super::{About, ActsOn, Channel, Effect, Evidence, Image, Parameter, Values};

/// Range and reflectance noise of constant size, a constant rate of drop, constant rates of outliers.
#[derive(Clone, Copy, Debug)]
pub struct NoiseFloor;

impl Effect for NoiseFloor {
    fn about(&self) -> About {
        About {
            name: "noise_floor",
            does: "measures with constant noise and loses a constant share of its rays",
            channel: Channel::RangeVariance,
            acts_on: ActsOn::ALL,
            covariates: &[],
            formula: "r + N(0, σ_r²), I + N(0, σ_I²), keep = 1 − p",
            source: "robust regression by a normal with a uniform outlier part: Hampel et al., Robust Statistics (1986)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::positive("range_sigma_m", 0.03, (1e-4, 1.0)),
            Parameter::positive("reflectance_sigma", 0.03, (1e-4, 0.5)),
            Parameter::probability("drop", 0.05, (1e-6, 0.9)),
            Parameter::probability("range_outliers", 0.01, (1e-6, 0.9)),
            Parameter::probability("reflectance_outliers", 0.01, (1e-6, 0.9)),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let report = &mut image.report;
        let variance = |old: &burn::tensor::Tensor<3>, i| (old.clone().square() + values.one(i).square()).sqrt();
        report.range_sigma_m = variance(&report.range_sigma_m, 0);
        report.reflectance_sigma = variance(&report.reflectance_sigma, 1);
        report.keep = report.keep.clone() * (values.one(2) * -1.0 + 1.0);
        report.range_outliers = report.range_outliers.clone() + values.one(3);
        report.reflectance_outliers = report.reflectance_outliers.clone() + values.one(4);
        image
    }

    /// From medians, which outliers do not move: a fit that starts too narrow takes everything for an outlier, and one that starts too wide
    /// overshoots.
    fn starts(&self, evidence: &Evidence) -> Vec<Vec<f64>> {
        let hits = || (0..evidence.range_m.len()).filter(|i| evidence.range_m[*i] > 0.0);
        let returned = || hits().filter(|i| evidence.measured_range_m[*i] > 0.0);
        let (all, some) = (hits().count() as f64, returned().count() as f64);
        // Standard deviation of a normal with this median deviation, and the share that lies outside of six of them.
        let spread = |of: &dyn Fn(usize) -> f32| {
            let sigma = Evidence::quantile(returned().map(|i| of(i).abs()), 0.5)? / 0.674_5;
            let far = returned().filter(|i| f64::from(of(*i).abs()) > 6.0 * sigma).count() as f64;
            Some((sigma, (far / some).clamp(1e-3, 0.5)))
        };
        let range = spread(&|i| evidence.measured_range_m[i] - evidence.range_m[i]);
        let reflectance = spread(&|i| evidence.measured_reflectance[i] - evidence.reflectance[i]);
        let (Some(range), Some(reflectance)) = (range, reflectance) else { return vec![] };
        let drop = (1.0 - some / all).clamp(1e-3, 0.9);
        vec![vec![range.0.clamp(1e-3, 1.0), reflectance.0.clamp(1e-3, 0.5), drop, range.1, reflectance.1]]
    }
}
