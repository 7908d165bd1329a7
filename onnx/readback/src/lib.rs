//! The network that goes to ONNX and back: every kind of layer and effect that our models have.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig, ConvTranspose2d, ConvTranspose2dConfig};
use burn::nn::{
    BatchNorm, BatchNormConfig, Embedding, EmbeddingConfig, GroupNorm, GroupNormConfig, InstanceNorm,
    InstanceNormConfig, PaddingConfig2d,
};
use burn::tensor::activation::{leaky_relu, relu, sigmoid};
use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions};
use burn::tensor::{Device, Int, Tensor, s};

/// A small encoder and decoder between an embedding and physical effects.
#[derive(Module, Debug)]
pub struct Net {
    classes: Embedding,
    stem: Conv2d,
    stem_norm: BatchNorm,
    down: Conv2d,
    down_norm: InstanceNorm,
    block: Conv2d,
    block_norm: GroupNorm,
    up: ConvTranspose2d,
    head: Conv2d,
}

impl Net {
    /// A network with random parameters.
    pub fn new(device: &Device) -> Self {
        let same = PaddingConfig2d::Explicit(1, 1, 1, 1);
        Self {
            classes: EmbeddingConfig::new(5, 2).init(device),
            stem: Conv2dConfig::new([4, 8], [3, 3]).init(device),
            stem_norm: BatchNormConfig::new(8).init(device),
            down: Conv2dConfig::new([8, 8], [3, 3]).with_stride([2, 2]).with_padding(same).init(device),
            down_norm: InstanceNormConfig::new(8).init(device),
            block: Conv2dConfig::new([8, 8], [1, 1]).init(device),
            block_norm: GroupNormConfig::new(2, 8).init(device),
            up: ConvTranspose2dConfig::new([8, 8], [4, 4]).with_stride([2, 2]).with_padding([1, 1]).init(device),
            head: Conv2dConfig::new([16, 2], [1, 1]).init(device),
        }
    }

    /// From a scan `[batch, 3, ring, column]` (range, reflectance, class) and noise `[batch, 1, ring, column]` to range and
    /// keep, both `[batch, 1, ring, column]`.
    pub fn forward(&self, (scan, noise): (Tensor<4>, Tensor<4>)) -> (Tensor<4>, Tensor<4>) {
        let [b, _, h, w] = scan.dims();
        let range = scan.clone().slice(s![.., 0..1, .., ..]);
        let reflectance = scan.clone().slice(s![.., 1..2, .., ..]);
        let class = scan.slice(s![.., 2..3, .., ..]).int().reshape([b, h * w]);
        let class = self.classes.forward(class).swap_dims(1, 2).reshape([b, 2, h, w]);
        let image = Tensor::cat(vec![range.clone() / 50.0, reflectance.clone(), class], 1);
        let stem = relu(self.stem_norm.forward(self.stem.forward(around(image))));
        let down = leaky_relu(self.down_norm.forward(self.down.forward(stem.clone())), 0.2);
        let block = down.clone() + self.block_norm.forward(self.block.forward(down.clone()));
        let up = relu(self.up.forward(block));
        let wide = interpolate(down, InterpolateOptions::new(InterpolateMode::Nearest).with_output_size([h, w]));
        let heads = self.head.forward(Tensor::cat(vec![up + wide, stem], 1));
        let range = range + heads.clone().slice(s![.., 0..1, .., ..]).tanh() * noise.clone();
        let keep = sigmoid(heads.slice(s![.., 1..2, .., ..]));
        effects(range, reflectance, noise, keep)
    }
}

/// Circular over the columns, reflected at the outer rings, by one.
fn around(x: Tensor<4>) -> Tensor<4> {
    let [_, _, h, w] = x.dims();
    let (left, right) = (x.clone().slice(s![.., .., .., w - 1..w]), x.clone().slice(s![.., .., .., 0..1]));
    let x = Tensor::cat(vec![left, x, right], 3);
    let (top, bottom) =
        (x.clone().slice(s![.., .., 1..2, ..]).flip([2]), x.clone().slice(s![.., .., h - 2..h - 1, ..]));
    Tensor::cat(vec![top, x, bottom], 2)
}

/// Attenuation, a comparison with noise, a running sum, angles and a ramp over the columns.
fn effects(range: Tensor<4>, reflectance: Tensor<4>, noise: Tensor<4>, keep: Tensor<4>) -> (Tensor<4>, Tensor<4>) {
    let w = range.dims()[3];
    let echo = reflectance * (range.clone() * -0.02).exp() * range.clone().clamp_min(1.0).powf_scalar(-2.0);
    let decibel = (echo.clamp(1e-6, 1.0) * 255.0 + 1.0).log();
    let lost = noise.clone().lower(keep.clone()).bool_and(range.clone().greater_elem(2.0)).bool_not();
    let column = Tensor::<1, Int>::arange(0..w as i64, &range.device()).float().reshape([1, 1, 1, w]);
    let sway = ((column * 0.1).sin() + (noise + 0.5).sqrt()).abs();
    let mean = range.clone().mean_dim(3);
    let swayed = range.clone().mask_where(range.clone().equal_elem(0.0), sway * 0.01 + mean) + range.cumsum(3) / 1000.0;
    (swayed.mask_fill(lost, 0.0), keep * decibel)
}
