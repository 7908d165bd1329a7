//! A discriminator of 70×70 patches: Isola et al., "Image-to-image translation with conditional adversarial networks" (2017), with
//! halvings that do not alias, as CUT has it.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::activation::leaky_relu;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use super::blur::halve;
use super::border::Border;
use super::layers::conv;
use super::norm::{Norm, NormKind};
use super::resnet::IMAGE_CHANNELS;

/// Slope of the rectifiers below zero.
const LEAK: f64 = 0.2;

/// Size of a [`PatchGan`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PatchGanConfig {
    /// Channels of the first layer; the papers' ndf.
    pub width: usize,
    /// What keeps features in bounds.
    pub norm: NormKind,
}

impl Default for PatchGanConfig {
    fn default() -> Self {
        Self { width: 64, norm: NormKind::Instance }
    }
}

/// The network: says of every patch of a scan how real it looks.
#[derive(Module, Debug)]
pub struct PatchGan {
    first: Conv2d,
    deeper: Vec<(Conv2d, Norm)>,
    head: Conv2d,
}

impl PatchGanConfig {
    /// A network with random weights.
    pub fn init(&self, device: &Device) -> PatchGan {
        let deeper = |i: usize| {
            let to = self.width << (i + 1);
            (conv(self.width << i, to, 4, 1, device), self.norm.init(to, device))
        };
        PatchGan {
            first: conv(IMAGE_CHANNELS, self.width, 4, 1, device),
            deeper: (0..3).map(deeper).collect(),
            head: conv(self.width << 3, 1, 4, 1, device),
        }
    }
}

impl PatchGan {
    /// Logits that patches are real, `[batch, 1, patch, patch]`, of range code and reflectance, `[batch, 2, ring, column]`.
    pub fn forward(&self, image: Tensor<4>) -> Tensor<4> {
        let mut x = halve(leaky_relu(self.first.forward(image), LEAK), Border::Mirror);
        for (i, (conv, norm)) in self.deeper.iter().enumerate() {
            x = leaky_relu(norm.forward(conv.forward(x)), LEAK);
            if i < 2 {
                x = halve(x, Border::Mirror);
            }
        }
        self.head.forward(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_network_has_the_papers_weights_and_patches() {
        let device = Device::flex();
        let network = PatchGanConfig::default().init(&device);
        assert_eq!(network.num_params(), 2_763_713);
        let small = PatchGanConfig { width: 4, ..PatchGanConfig::default() }.init(&device);
        assert_eq!(small.forward(Tensor::zeros([1, 2, 64, 128], &device)).dims(), [1, 1, 6, 14]);
    }
}
