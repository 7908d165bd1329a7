//! What residual networks are made of.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use super::border::Border;
use super::layers::conv;
use super::norm::Norm;
use super::resnet::{HALVINGS, ResnetConfig};

/// Convolution, norm, `ReLU`.
#[derive(Module, Debug)]
pub(super) struct Stage {
    pub(super) conv: Conv2d,
    pub(super) norm: Norm,
}

/// x + norm(conv(relu(norm(conv(x))))).
#[derive(Module, Debug)]
pub(super) struct Block {
    first: Stage,
    second: Stage,
}

impl Stage {
    /// Of the kind that a generator's config says.
    pub(super) fn new(channels: [usize; 2], size: usize, of: &ResnetConfig, device: &Device) -> Self {
        Self { conv: conv(channels, size, 0, of.gain, device), norm: of.norm.init(channels[1], device) }
    }

    pub(super) fn forward(&self, x: Tensor<4>, border: Border) -> Tensor<4> {
        relu(self.norm.forward(self.conv.forward(border.pad(x, 1))))
    }
}

impl Block {
    /// At a generator's least size.
    pub(super) fn new(of: &ResnetConfig, device: &Device) -> Self {
        let channels = of.width << HALVINGS;
        let stage = || Stage::new([channels, channels], 3, of, device);
        Self { first: stage(), second: stage() }
    }

    pub(super) fn forward(&self, x: Tensor<4>, border: Border) -> Tensor<4> {
        let y = self.first.forward(x.clone(), border);
        x + self.second.norm.forward(self.second.conv.forward(border.pad(y, 1)))
    }
}
