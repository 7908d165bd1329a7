//! Ray-drop synthesis: which rays a sensor reports, drawn so that gradients pass.

use burn::tensor::Tensor;
use burn::tensor::activation::sigmoid;

use super::generated::Generated;

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
        let generated = Generated {
            image: keep_logit.zeros_like().repeat_dim(1, 2),
            keep_logit: keep_logit.clone(),
            scatter: None,
        };
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
}
