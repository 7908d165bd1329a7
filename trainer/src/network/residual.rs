//! What residual networks are made of.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use super::border::Border;
use super::layers::conv;
use super::norm::{Norm, NormKind};

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
    pub(super) fn new([from, to]: [usize; 2], size: usize, norm: NormKind, device: &Device) -> Self {
        Self { conv: conv(from, to, size, 0, device), norm: norm.init(to, device) }
    }

    pub(super) fn forward(&self, x: Tensor<4>, border: Border) -> Tensor<4> {
        relu(self.norm.forward(self.conv.forward(border.pad(x, 1))))
    }
}

impl Block {
    pub(super) fn new(channels: usize, norm: NormKind, device: &Device) -> Self {
        let stage = || Stage::new([channels, channels], 3, norm, device);
        Self { first: stage(), second: stage() }
    }

    pub(super) fn forward(&self, x: Tensor<4>, border: Border) -> Tensor<4> {
        let y = self.first.forward(x.clone(), border);
        x + self.second.norm.forward(self.second.conv.forward(border.pad(y, 1)))
    }
}
