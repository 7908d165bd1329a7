//! The layers that networks are made of: Xavier's weights, no bias to begin with.

use burn::module::Initializer;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::Device;

/// CUT's gain of Xavier's normal weights: Glorot and Bengio, "Understanding the difficulty of training deep feedforward neural networks"
/// (2010).
pub(super) const CUTS_GAIN: f64 = 0.02;

/// A square convolution of stride 1, padded with so many zeros on every side, Xavier's weights times `gain` to begin with.
pub(super) fn conv([from, to]: [usize; 2], size: usize, zeros: usize, gain: f64, device: &Device) -> Conv2d {
    let padding = PaddingConfig2d::Explicit(zeros, zeros, zeros, zeros);
    let config = Conv2dConfig::new([from, to], [size, size]).with_padding(padding);
    let mut conv = config.with_initializer(Initializer::XavierNormal { gain }).init(device);
    conv.bias = Some(Initializer::Zeros.init([to], device));
    conv
}

/// A linear layer, Xavier's weights times `gain` to begin with.
pub(super) fn linear(from: usize, to: usize, gain: f64, device: &Device) -> Linear {
    let config = LinearConfig::new(from, to).with_initializer(Initializer::XavierNormal { gain });
    let mut linear = config.init(device);
    linear.bias = Some(Initializer::Zeros.init([to], device));
    linear
}
