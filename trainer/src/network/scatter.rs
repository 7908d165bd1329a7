//! How far reflectances scatter about what a network says of them: Laplace's distribution, whose scale it says as well.

use burn::tensor::{Tensor, s};

use super::generated::Generated;
use super::resnet::IMAGE_CHANNELS;

/// Scale that a network begins with, in the reflectance's code.
const SCALE: f32 = 0.1;

/// The most that the scale is multiplied or divided by.
const REACH: f32 = 20.0;

/// How near to 0 and 1 uniform numbers may come.
const MARGIN: f32 = 1e-6;

/// What the last layer says of the scale, as a scale.
pub(super) fn scale(said: Tensor<4>) -> Tensor<4> {
    let most = REACH.ln();
    ((said / most).tanh() * most).exp() * SCALE
}

impl Generated {
    /// The image with its reflectances drawn by uniform numbers in (0, 1), `[batch, 1, ring, column]`; as it is, where they do not scatter.
    ///
    /// No reflectance is reported beyond −1 or 1, but gradients pass as if it were.
    pub fn drawn(&self, uniform: Tensor<4>) -> Tensor<4> {
        let Some(scatter) = &self.scatter else { return self.image.clone() };
        let channels = |from: usize, to: usize| self.image.clone().slice(s![.., from..to, .., ..]);
        let drawn = channels(IMAGE_CHANNELS - 1, IMAGE_CHANNELS) + scatter.clone() * laplace(uniform);
        let beyond = drawn.clone().detach() - drawn.clone().detach().clamp(-1.0, 1.0);
        Tensor::cat(vec![channels(0, IMAGE_CHANNELS - 1), drawn - beyond], 1)
    }
}

/// Numbers of Laplace's distribution of scale 1, whose mean distance from 0 is 1, of uniform ones from 0 to 1.
pub fn laplace(uniform: Tensor<4>) -> Tensor<4> {
    let uniform = uniform.clamp(MARGIN, 1.0 - MARGIN);
    let side = |x: Tensor<4>| (x * 2.0).clamp_max(1.0).log();
    side(uniform.clone()) - side(uniform * -1.0 + 1.0)
}

/// The continuous ranked probability score of Laplace's distribution, `error` away from what came true: |e| + b e^(−|e|/b) − ¾ b (Jordan,
/// Krüger and Lerch, "Evaluating probabilistic forecasts with scoringRules", 2019). Like an absolute error it is in units of what is
/// foretold, and without scatter it is that.
pub fn ranked_probability_score(error: Tensor<4>, scatter: &Tensor<4>) -> Tensor<4> {
    let off = error.abs();
    off.clone() + scatter.clone() * ((off / scatter.clone()).neg().exp() - 0.75)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Distribution, TensorData};

    fn row(values: &[f32], device: &Device) -> Tensor<4> {
        Tensor::from_data(TensorData::new(values.to_vec(), [1, 1, 1, values.len()]), device)
    }

    fn values(x: Tensor<4>) -> Vec<f32> {
        x.into_data().iter::<f32>().collect()
    }

    #[test]
    fn drawn_reflectances_are_as_far_from_the_middle_as_the_scale_says_on_both_sides() {
        let device = Device::flex();
        device.seed(4);
        let rays = 100_000;
        let image = Tensor::cat(
            vec![Tensor::<4>::zeros([1, 1, 1, rays], &device) + 0.7, Tensor::zeros([1, 1, 1, rays], &device) + 0.1],
            1,
        );
        let scatter = Some(Tensor::zeros([1, 1, 1, rays], &device) + 0.05);
        let generated = Generated { keep_logit: image.clone().slice(s![.., 0..1]), image, scatter };
        let uniform = Tensor::random([1, 1, 1, rays], Distribution::Uniform(0.0, 1.0), &device);
        let drawn = generated.drawn(uniform);
        assert!(values(drawn.clone().slice(s![.., 0..1])).iter().all(|code| *code == 0.7));
        let off: Vec<f32> = values(drawn.slice(s![.., 1..2])).into_iter().map(|x| x - 0.1).collect();
        let mean = off.iter().map(|x| x.abs()).sum::<f32>() / rays as f32;
        assert!((mean - 0.05).abs() < 0.001, "{mean}");
        // Half lie above; e⁻² of each side is two scales off and more.
        let beyond = |far: f32| off.iter().filter(|x| **x > far).count() as f32 / rays as f32;
        assert!((beyond(0.0) - 0.5).abs() < 0.01 && (beyond(0.1) - 0.5 * (-2f32).exp()).abs() < 0.005);
    }

    #[test]
    fn nothing_is_reported_beyond_the_code_and_gradients_pass_all_the_same() {
        let device = Device::flex().autodiff();
        let middle = row(&[0.9, 0.0], &device).require_grad();
        let image = Tensor::cat(vec![middle.zeros_like(), middle.clone()], 1);
        let scatter = Some(middle.zeros_like() + 0.5);
        let drawn = Generated { keep_logit: middle.zeros_like(), image, scatter }.drawn(row(&[0.9, 0.5], &device));
        assert_eq!(values(drawn.clone().slice(s![.., 1..2])), [1.0, 0.0]);
        let gradient = middle.grad(&drawn.sum().backward()).expect("a gradient");
        assert_eq!(gradient.into_data().iter::<f32>().collect::<Vec<_>>(), [1.0, 1.0]);
    }

    #[test]
    fn the_score_is_the_integral_that_defines_it() {
        let device = Device::flex();
        for (error, scatter) in [(0.0, 0.3), (0.2, 0.3), (-0.7, 0.3), (1.5, 0.05)] {
            let below = |x: f64| if x < 0.0 { 0.5 * (x / scatter).exp() } else { 1.0 - 0.5 * (-x / scatter).exp() };
            // ∫ (F(x) − [x ≥ e])² dx.
            let step = 1e-4;
            let integral: f64 = (-100_000..100_000)
                .map(|i| (f64::from(i) + 0.5) * step)
                .map(|x| (below(x) - f64::from(u8::from(x >= error))).powi(2) * step)
                .sum();
            let score = ranked_probability_score(row(&[error as f32], &device), &row(&[scatter as f32], &device));
            let score = f64::from(values(score)[0]);
            assert!((score - integral).abs() < 1e-4, "{error} {scatter}: {score} {integral}");
        }
    }

    #[test]
    fn a_scale_is_positive_and_bounded_whatever_the_layer_says() {
        let scales = values(scale(row(&[-1e6, 0.0, 1e6], &Device::flex())));
        for (found, expected) in scales.iter().zip([SCALE / REACH, SCALE, SCALE * REACH]) {
            assert!((found / expected - 1.0).abs() < 1e-4, "{scales:?}");
        }
    }
}
