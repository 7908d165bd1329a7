//! What training minimises.

use burn::tensor::Tensor;
use burn::tensor::activation::relu;

use crate::data::Batch;
use crate::network::Prediction;

/// The parts of a loss, each a scalar `[1]`.
#[derive(Clone, Debug)]
pub struct Loss {
    /// Cross-entropy of the keep mask, nats a ray.
    pub keep: Tensor<1>,
    /// Mean absolute error of the reflectance.
    pub reflectance: Tensor<1>,
    /// Mean absolute error of ln(range + 1).
    pub range: Tensor<1>,
    /// Their weighted sum.
    pub total: Tensor<1>,
}

/// What the parts weigh beside the cross-entropy of the keep mask.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Of the reflectance.
    pub reflectance: f32,
    /// Of ln(range + 1).
    pub range: f32,
}

impl Loss {
    /// The loss of a prediction.
    pub fn new(prediction: Prediction, batch: &Batch, weights: Weights) -> Self {
        let keep = weighted_mean(cross_entropy(prediction.keep_logit, batch.keep.clone()), batch.keep_weight.clone());
        let reflectance = burn::tensor::activation::sigmoid(prediction.reflectance_logit) - batch.reflectance.clone();
        let reflectance = weighted_mean(reflectance.abs(), batch.measured.clone());
        let range = weighted_mean((prediction.log_range - batch.log_range.clone()).abs(), batch.measured.clone());
        let total = keep.clone() + reflectance.clone() * weights.reflectance + range.clone() * weights.range;
        Self { keep, reflectance, range, total }
    }
}

/// −y·ln σ(x) − (1 − y)·ln(1 − σ(x)), in the form that does not overflow.
pub(crate) fn cross_entropy(logit: Tensor<4>, outcome: Tensor<4>) -> Tensor<4> {
    relu(logit.clone()) - logit.clone() * outcome + (logit.abs().neg().exp() + 1.0).log()
}

/// The mean of values that count as much as their weights say.
pub(crate) fn weighted_mean(value: Tensor<4>, weight: Tensor<4>) -> Tensor<1> {
    // A batch without a single case (unobserved drops only) weighs nothing rather than 0/0.
    (value * weight.clone()).sum() / weight.sum().clamp_min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    #[test]
    fn cross_entropy_is_minus_the_log_of_what_came_true_even_far_out() {
        let device = Device::flex();
        let logit = Tensor::<4>::from_floats([[[[0.0, 2.0, -80.0, 80.0]]]], &device);
        let outcome = Tensor::<4>::from_floats([[[[1.0, 0.0, 1.0, 1.0]]]], &device);
        let loss: Vec<f32> = cross_entropy(logit, outcome).into_data().iter::<f32>().collect();
        let expected = [2f32.ln(), 2.0 + (1.0 + (-2f32).exp()).ln(), 80.0, 0.0];
        for (loss, expected) in loss.iter().zip(expected) {
            assert!((loss - expected).abs() < 1e-5, "{loss} for {expected}");
        }
    }
}
