//! Ray-drop synthesis: which rays a sensor reports, drawn so that gradients pass.

use burn::tensor::Tensor;
use burn::tensor::activation::sigmoid;

use super::resnet::Generated;

/// What an image shows of a ray that was not reported.
pub const DROPPED: f32 = -1.0;

impl Generated {
    /// The mask of the rays that are reported, 1 or 0, `[batch, 1, ring, column]`, drawn by uniform numbers in (0, 1).
    ///
    /// The Gumbel-sigmoid of Jang et al. and Maddison et al. (2017) for two classes: σ((logit + L)/α) with logistic L, above ½; the gradient
    /// is that of the sigmoid itself (straight through). The mask is 1 with probability σ(logit), whatever α is.
    pub fn reported(&self, uniform: Tensor<4>, alpha: f64) -> Tensor<4> {
        let uniform = uniform.clamp(1e-6, 1.0 - 1e-6);
        let logistic = (uniform.clone() / (uniform * -1.0 + 1.0)).log();
        let soft = sigmoid((self.keep_logit.clone() + logistic) / alpha);
        let hard = soft.clone().detach().greater_elem(0.5).float();
        soft.clone() + (hard - soft.detach())
    }

    /// The image as it is reported: rays that are not in the `mask` show [`DROPPED`].
    pub fn masked(&self, mask: &Tensor<4>) -> Tensor<4> {
        (self.image.clone() - DROPPED) * mask.clone() + DROPPED
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Distribution, TensorData};

    #[test]
    fn as_many_rays_are_reported_as_the_logit_says_and_gradients_pass() {
        let device = Device::flex().autodiff();
        device.seed(2);
        let logits = TensorData::new([-2f32, -0.5, 0.0, 1.0].repeat(10_000), [1, 1, 10_000, 4]);
        let keep_logit = Tensor::<4>::from_data(logits, &device).require_grad();
        let generated = Generated { image: keep_logit.zeros_like().repeat_dim(1, 2), keep_logit: keep_logit.clone() };
        for alpha in [0.5, 1.0] {
            let uniform = Tensor::random([1, 1, 10_000, 4], Distribution::Uniform(0.0, 1.0), &device);
            let mask = generated.reported(uniform, alpha);
            let values: Vec<f32> = mask.clone().into_data().iter::<f32>().collect();
            assert!(values.iter().all(|x| x.abs() < 1e-6 || (x - 1.0).abs() < 1e-6));
            for (i, logit) in [-2f64, -0.5, 0.0, 1.0].into_iter().enumerate() {
                let share = values.iter().skip(i).step_by(4).sum::<f32>() / 10_000.0;
                let expected = 1.0 / (1.0 + (-logit).exp());
                assert!((f64::from(share) - expected).abs() < 0.02, "{logit}: {share} of {expected}");
            }
            let gradient = keep_logit.grad(&mask.sum().backward()).expect("a gradient");
            let of_logits: Vec<f32> = gradient.mean_dim(2).into_data().iter::<f32>().collect();
            assert!(of_logits.iter().all(|x| *x > 0.0), "{of_logits:?}");
        }
    }

    #[test]
    fn what_is_not_reported_shows_as_dropped() {
        let device = Device::flex();
        let image = Tensor::<4>::zeros([1, 2, 1, 2], &device) + 0.3;
        let generated = Generated { keep_logit: Tensor::zeros([1, 1, 1, 2], &device), image };
        let mask = Tensor::from_data(TensorData::new(vec![1f32, 0.0], [1, 1, 1, 2]), &device);
        let shown: Vec<f32> = generated.masked(&mask).into_data().iter::<f32>().collect();
        for (shown, expected) in shown.iter().zip([0.3, DROPPED, 0.3, DROPPED]) {
            assert!((shown - expected).abs() < 1e-6);
        }
    }
}
