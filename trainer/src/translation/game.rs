//! What a discriminator and its generator play for.

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

use crate::loss::cross_entropy;

/// What a discriminator and its generator play for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Game {
    /// Squared distance to 1 and 0: Mao et al., "Least squares generative adversarial networks" (2017); CUT's choice.
    #[default]
    LeastSquares,
    /// Cross entropy: Goodfellow et al., "Generative adversarial nets" (2014); CLS2R's equation 7.
    Original,
}

impl Game {
    /// The discriminator's loss: of its logits of real scans and of answers, of any size.
    pub fn discriminator(self, real: Tensor<4>, answer: Tensor<4>) -> Tensor<1> {
        (self.distance(real, true) + self.distance(answer, false)) / 2.0
    }

    /// The generator's loss: of the discriminator's logits of its answers.
    pub fn generator(self, answer: Tensor<4>) -> Tensor<1> {
        self.distance(answer, true)
    }

    /// How far logits are from what they should be.
    fn distance(self, logit: Tensor<4>, real: bool) -> Tensor<1> {
        let target = f32::from(u8::from(real));
        match self {
            Self::LeastSquares => (logit - target).square().mean(),
            Self::Original => {
                let outcome = logit.zeros_like() + target;
                cross_entropy(logit, outcome).mean()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    #[test]
    fn losses_are_those_of_the_papers() {
        let device = Device::flex();
        let logits = |value: f32| Tensor::<4>::full([1, 1, 1, 2], value, &device);
        let value = |x: Tensor<1>| x.into_scalar::<f32>();
        let squares = Game::LeastSquares;
        assert!((value(squares.discriminator(logits(0.5), logits(0.2))) - 0.145).abs() < 1e-6);
        assert!((value(squares.generator(logits(0.2))) - 0.64).abs() < 1e-6);
        let sigmoid = |x: f32| 1.0 / (1.0 + (-x).exp());
        let expected = -(sigmoid(0.5).ln() + (1.0 - sigmoid(0.2)).ln()) / 2.0;
        assert!((value(Game::Original.discriminator(logits(0.5), logits(0.2))) - expected).abs() < 1e-6);
        assert!((value(Game::Original.generator(logits(0.2))) + sigmoid(0.2).ln()).abs() < 1e-6);
    }
}
