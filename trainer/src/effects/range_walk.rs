//! Range walk: a weak echo crosses the detector's threshold later than a strong one.

use burn::tensor::Tensor;

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// Reflectance below which the walk grows no further.
const DARKEST: f64 = 0.02;
/// Reflectance at which the amplitude is the walk's slope against ln I.
const TYPICAL: f64 = 0.3;
/// Largest exponent.
const STEEPEST: f64 = 1.5;

/// r + a·f(I) with Box's and Cox's family of powers f(I) = (1 − I^λ)/(λ·I₀^λ): −ln I at λ = 0, straight at λ = 1, 1/I − 1 at λ = −1; always
/// 0 at I = 1, and of slope −1 against ln I at I₀, so that amplitude and exponent are told apart.
#[derive(Clone, Copy, Debug)]
pub(super) struct RangeWalk;

impl Effect for RangeWalk {
    fn about(&self) -> About {
        About {
            name: "range_walk",
            does: "reports dark surfaces as {amplitude_m} {farther away|nearer} for each e-fold of reflectance that they lack",
            channel: Channel::Range,
            acts_on: ActsOn::RANGE,
            covariates: &["reflectance"],
            formula: "r + a·(1 − I^λ)/(λ·0.3^λ), which is r − a·ln I at λ = 0",
            source: "walk error: Amann et al., Laser Ranging: a Critical Review (Optical Engineering, 2001); powers: Box and Cox, An Analysis of Transformations (1964)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("amplitude_m", 0.02, (-0.5, 0.5)), Parameter::free("exponent", 0.5, (-STEEPEST, STEEPEST))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let log = image.surface.reflectance.clone().clamp(DARKEST, 1.0).log();
        let exponent = values.one(1).clamp(-STEEPEST, STEEPEST);
        let walk = power(&log, &exponent) * (exponent * -TYPICAL.ln()).exp() * values.one(0);
        image.report.range_m = image.report.range_m + walk;
        image
    }
}

/// (1 − e^{λx})/λ = −x·e^{y}·sinh(y)/y with y = λx/2; the power series of sinh(y)/y holds at λ = 0 too.
fn power(x: &Tensor<3>, exponent: &Tensor<3>) -> Tensor<3> {
    let y = x.clone() * exponent.clone() * 0.5;
    let square = y.clone().square();
    // Coefficients of y² in nested form; |y| ≤ 3, where the ninth term is below 1e-5 of the sum.
    let series = [272.0, 210.0, 156.0, 110.0, 72.0, 42.0, 20.0, 6.0]
        .into_iter()
        .fold(square.clone() * 0.0 + 1.0, |sum, n| sum * square.clone() / n + 1.0);
    x.clone() * y.exp() * series * -1.0
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_the_amplitude_and_the_form() {
        for truth in [[0.03, 0.0], [0.05, 0.5], [-0.03, 1.0], [0.02, -0.5]] {
            Trial::of(Arc::new(RangeWalk), &truth).each_within(&[0.001, 0.05]);
        }
    }

    #[test]
    fn the_powers_are_right_across_an_exponent_of_zero() {
        let device = Device::flex();
        for exponent in [-1.5, -0.5, -1e-6, 0.0, 1e-3, 0.5, 1.0, 1.5_f64] {
            for i in [0.02, 0.1, 0.5, 0.9, 1.0_f64] {
                let expected = if exponent == 0.0 { -i.ln() } else { (1.0 - i.powf(exponent)) / exponent };
                let at = |x: f64| Tensor::<1>::from_floats([x as f32], &device).reshape([1, 1, 1]);
                let found: f64 = power(&at(i.ln()), &at(exponent)).into_scalar();
                assert!(
                    (found - expected).abs() < 1e-4 * (1.0 + expected),
                    "{found} for {expected} at {exponent}, {i}"
                );
            }
        }
    }
}
