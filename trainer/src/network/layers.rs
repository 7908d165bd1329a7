//! The layers that networks are made of: Xavier's weights, no bias to begin with.

use burn::module::Initializer;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::Device;

/// Xavier's normal weights times this: Glorot and Bengio, "Understanding the difficulty of training deep feedforward neural networks"
/// (2010), with CUT's gain.
const GAIN: f64 = 0.02;

/// A square convolution of stride 1, padded with so many zeros on every side.
pub(super) fn conv(from: usize, to: usize, size: usize, zeros: usize, device: &Device) -> Conv2d {
    let padding = PaddingConfig2d::Explicit(zeros, zeros, zeros, zeros);
    let config = Conv2dConfig::new([from, to], [size, size]).with_padding(padding);
    let mut conv = config.with_initializer(Initializer::XavierNormal { gain: GAIN }).init(device);
    conv.bias = Some(Initializer::Zeros.init([to], device));
    conv
}

/// A linear layer.
pub(super) fn linear(from: usize, to: usize, device: &Device) -> Linear {
    let config = LinearConfig::new(from, to).with_initializer(Initializer::XavierNormal { gain: GAIN });
    let mut linear = config.init(device);
    linear.bias = Some(Initializer::Zeros.init([to], device));
    linear
}
