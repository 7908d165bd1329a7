//! A discriminator of 70×70 patches: Isola et al., "Image-to-image translation with conditional adversarial networks" (2017), with
//! halvings that do not alias, as CUT has it.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::activation::leaky_relu;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use super::blur::halve;
use super::border::Border;
use super::layers::{CUTS_GAIN, conv};
use super::norm::{Norm, NormKind};
use super::resnet::IMAGE_CHANNELS;

/// Slope of the rectifiers below zero.
const LEAK: f64 = 0.2;

/// Deep layers have eight times the first one's channels at most.
const MOST_DOUBLINGS: usize = 3;

/// Size of a [`PatchGan`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PatchGanConfig {
    /// Channels of the images, no config's to say: a range image has [`IMAGE_CHANNELS`].
    #[serde(skip)]
    pub channels: usize,
    /// Channels of the first layer; the papers' ndf.
    pub width: usize,
    /// Halvings: 3 for patches of 70×70 pixels, as in the papers; 2 for 34×34, 1 for 16×16, which sensors of few rings need.
    pub halvings: usize,
    /// What keeps features in bounds.
    pub norm: NormKind,
    /// What Xavier's weights are multiplied by to begin with, as for [`ResnetConfig`](super::ResnetConfig).
    pub gain: f64,
}

impl Default for PatchGanConfig {
    fn default() -> Self {
        Self { channels: IMAGE_CHANNELS, width: 64, halvings: 3, norm: NormKind::Instance, gain: CUTS_GAIN }
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
        let width = |i: usize| self.width << i.min(MOST_DOUBLINGS);
        let deeper = |i: usize| {
            let channels = [width(i), width(i + 1)];
            (conv(channels, 4, 1, self.gain, device), self.norm.init(channels[1], device))
        };
        PatchGan {
            first: conv([self.channels, self.width], 4, 1, self.gain, device),
            deeper: (0..self.halvings).map(deeper).collect(),
            head: conv([width(self.halvings), 1], 4, 1, CUTS_GAIN, device),
        }
    }

    /// Whether an image of so many rings, or columns, holds a patch.
    pub fn fits(&self, pixels: usize) -> bool {
        // A convolution takes one pixel away, a halving rounds up.
        let halved = (0..self.halvings).fold(pixels, |n, _| n.saturating_sub(1).div_ceil(2));
        halved > 2
    }
}

impl PatchGan {
    /// Logits that patches are real, `[batch, 1, patch, patch]`, of images, `[batch, channel, ring, column]`.
    pub fn forward(&self, image: Tensor<4>) -> Tensor<4> {
        let mut x = leaky_relu(self.first.forward(image), LEAK);
        for (conv, norm) in &self.deeper {
            x = leaky_relu(norm.forward(conv.forward(halve(x, Border::Mirror))), LEAK);
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

    #[test]
    fn what_fits_is_judged_and_what_does_not_is_known_before() {
        let device = Device::flex();
        for (halvings, least) in [(1, 6), (2, 12), (3, 24)] {
            let config = PatchGanConfig { width: 2, halvings, ..PatchGanConfig::default() };
            assert!(config.fits(least) && !config.fits(least - 1), "{halvings}");
            let judged = config.init(&device).forward(Tensor::zeros([1, 2, least, 64], &device));
            assert_eq!(judged.dims()[2], 1);
        }
    }
}
