//! The distributions that a range scatters by around a surface.

use burn::tensor::Tensor;

/// The sum of a normal number and a Cauchy distributed one, nearly: a mixture of one of each, exact where either is 0 (Thompson, Cox and
/// Hastings, "Rietveld refinement of Debye-Scherrer synchrotron X-ray data from `Al2O3`", 1987).
pub(super) struct Voigt {
    /// Share of the Cauchy distribution.
    pub(super) share: Tensor<3>,
    /// Its half width at half maximum.
    pub(super) half_width: Tensor<3>,
    /// Standard deviation of the normal one.
    pub(super) sigma: Tensor<3>,
}

impl Voigt {
    pub(super) fn new(sigma: &Tensor<3>, half_width: &Tensor<3>) -> Self {
        let to_width = (8.0 * std::f64::consts::LN_2).sqrt();
        let normal_width = sigma.clone() * to_width;
        let width = half_width.clone() * (2.0 * 0.5346)
            + (half_width.clone().square() * (4.0 * 0.2166) + normal_width.square()).sqrt();
        let ratio = half_width.clone() * 2.0 / width.clone();
        let share = ((ratio.clone() * 0.11116 - 0.47719) * ratio.clone() + 1.36603) * ratio;
        Self { share, half_width: width.clone() * 0.5, sigma: width * (1.0 / to_width) }
    }
}

/// Density of a Cauchy distributed number of this half width at half maximum.
pub(super) fn cauchy(x: &Tensor<3>, half_width: &Tensor<3>) -> Tensor<3> {
    half_width.clone() * std::f64::consts::FRAC_1_PI / (x.clone().square() + half_width.clone().square())
}

/// Standard normal density.
pub(super) fn normal(z: &Tensor<3>) -> Tensor<3> {
    (z.clone().square() * -0.5).exp() * (1.0 / (2.0 * std::f64::consts::PI).sqrt())
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::effects::draw;

    fn one(x: f64) -> Tensor<3> {
        Tensor::full([1, 1, 1], x, &Device::flex())
    }

    #[test]
    fn a_doubted_range_is_the_sum_of_a_normal_and_a_cauchy_number() {
        let sigma = 0.05;
        for half_width in [0.0, 0.01, 0.05, 0.2] {
            for x in [0.0, 0.04, 0.1, 0.3, 1.0] {
                let voigt = Voigt::new(&one(sigma), &one(half_width));
                let bell = normal(&(one(x) / voigt.sigma.clone())) / voigt.sigma;
                let density = bell.clone() + (cauchy(&one(x), &voigt.half_width) - bell) * voigt.share;
                let density = density.into_scalar::<f64>();
                // The convolution over the normal's quantiles.
                let n = 4000;
                let u = (Tensor::arange(0..n, &Device::flex()).float() + 0.5) / n as f32;
                let drawn = draw::normal(u.reshape([1, 1, -1])) * sigma;
                let drawn: Vec<f64> = drawn.into_data().iter::<f64>().collect();
                let cauchy = |d: &f64| half_width / std::f64::consts::PI / ((x - d).powi(2) + half_width * half_width);
                let bell = (-0.5 * (x / sigma).powi(2)).exp() / (sigma * (2.0 * std::f64::consts::PI).sqrt());
                let exact = if half_width > 0.0 { drawn.iter().map(cauchy).sum::<f64>() / n as f64 } else { bell };
                let peak = 1.0 / (sigma * 2.5 + half_width * 3.2);
                assert!(
                    (density - exact).abs() < 0.02 * peak + 0.06 * exact,
                    "{density} for {exact} at {x}, {half_width}"
                );
            }
        }
    }
}
