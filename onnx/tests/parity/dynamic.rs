//! Free axes: a whole network at sizes that it was never traced at.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig, ConvTranspose2d, ConvTranspose2dConfig};
use burn::nn::{
    BatchNorm, BatchNormConfig, GroupNorm, GroupNormConfig, InstanceNorm, InstanceNormConfig, PaddingConfig2d,
};
use burn::tensor::activation::{leaky_relu, relu, sigmoid};
use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions, PadMode};
use burn::tensor::{Device, Tensor, s};

use crate::comparison::{At, Case, function_agrees, image};
use crate::sample::{floats, floats_between, scrambled};

/// Circular padding of the columns, reflective padding of the rows.
fn around(x: Tensor<4>, width: usize) -> Tensor<4> {
    let [_, _, h, w] = x.dims();
    let left = x.clone().slice(s![.., .., .., w - width..w]);
    let x = Tensor::cat(vec![left, x.clone(), x.slice(s![.., .., .., 0..width])], 3);
    let top = x.clone().slice(s![.., .., 1..=width, ..]).flip([2]);
    let bottom = x.clone().slice(s![.., .., h - 1 - width..h - 1, ..]).flip([2]);
    Tensor::cat(vec![top, x, bottom], 2)
}

/// A small generator with every layer kind that ours have: strides, skips, both ways of growing, three norms, two heads.
#[derive(Module, Debug)]
pub(crate) struct Generator {
    stem: Conv2d,
    stem_norm: InstanceNorm,
    down: Conv2d,
    down_norm: BatchNorm,
    block: Conv2d,
    block_norm: GroupNorm,
    up: ConvTranspose2d,
    up_norm: InstanceNorm,
    last: Conv2d,
    range: Conv2d,
    keep: Conv2d,
}

impl Generator {
    pub(crate) fn new(device: &Device) -> Self {
        let pad = PaddingConfig2d::Explicit(1, 1, 1, 1);
        Self {
            stem: Conv2dConfig::new([3, 8], [3, 3]).init(device),
            stem_norm: InstanceNormConfig::new(8).init(device),
            down: Conv2dConfig::new([8, 16], [3, 3]).with_stride([2, 2]).init(device),
            down_norm: BatchNormConfig::new(16).init(device),
            block: Conv2dConfig::new([16, 16], [3, 3]).with_stride([1, 2]).with_padding(pad).init(device),
            block_norm: GroupNormConfig::new(4, 16).init(device),
            up: ConvTranspose2dConfig::new([16, 8], [3, 3])
                .with_stride([2, 2])
                .with_padding([1, 1])
                .with_padding_out([1, 1])
                .init(device),
            up_norm: InstanceNormConfig::new(8).init(device),
            last: Conv2dConfig::new([16, 8], [3, 3]).init(device),
            range: Conv2dConfig::new([8, 1], [1, 1]).init(device),
            keep: Conv2dConfig::new([8, 1], [1, 1]).init(device),
        }
    }

    pub(crate) fn forward(&self, (scan, noise): (Tensor<4>, Tensor<4>)) -> (Tensor<4>, Tensor<4>) {
        let measured = scan.clone().slice(s![.., 0..1, .., ..]);
        let missing = measured.clone().equal_elem(0.0);
        let stem = relu(self.stem_norm.forward(self.stem.forward(around(scan, 1))));
        let down = leaky_relu(self.down_norm.forward(self.down.forward(around(stem.clone(), 1))), 0.2);
        let block = self.block_norm.forward(self.block.forward(down.clone().pad((0, 0, 0, 0), PadMode::Reflect)));
        let [_, _, h, w] = down.dims();
        let wide = interpolate(block, InterpolateOptions::new(InterpolateMode::Nearest).with_output_size([h, w]));
        let up = leaky_relu(self.up_norm.forward(self.up.forward(down + wide)), 0.2);
        let last = relu(self.last.forward(around(Tensor::cat(vec![up, stem], 1), 1)));
        let noisy = self.range.forward(last.clone()).tanh() + noise * 0.1;
        ((measured + noisy).mask_fill(missing, 0.0), sigmoid(self.keep.forward(last)))
    }
}

/// A scan with missing returns, and noise.
pub(crate) fn scan(at: At) -> (Tensor<4>, Tensor<4>) {
    let scan = floats_between([at.batch, 3, 8, at.column], 1, -0.5, 1.5).clamp_min(0.0);
    (scan, floats([at.batch, 1, 8, at.column], 2))
}

#[test]
fn a_generator_agrees_at_every_size() {
    let module = scrambled(Generator::new(&Device::flex()), 11);
    Case { module, inputs: scan, forward: |net: &Generator, input| net.forward(input), multiple: 4 }.agrees();
}

/// An output size of (w + 1) / 2 looks like w / 2 at even sizes: it is taken from the layer that has it.
#[test]
fn odd_sizes_through_a_stride_agree() {
    let conv: Conv2d = scrambled(
        Conv2dConfig::new([3, 3], [3, 3])
            .with_stride([2, 2])
            .with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1))
            .init(&Device::flex()),
        1,
    );
    let forward = |conv: &Conv2d, x: Tensor<4>| {
        let half = conv.forward(x);
        let [b, c, h, w] = half.dims();
        half.mean_dim(2).expand([b, c, h, w]).reshape([b, c * h, w]).swap_dims(0, 2)
    };
    Case { module: conv, inputs: image, forward, multiple: 1 }.agrees();
}

#[test]
fn sizes_that_only_arithmetic_knows_agree() {
    function_agrees(image, |x: Tensor<4>| {
        let [b, _, _, w] = x.dims();
        let device = x.device();
        let wider = Tensor::<4>::zeros([b, 3, 4, 2 * w + 1], &device);
        (wider, x.slice(s![.., .., .., 0..w]))
    });
}

#[test]
fn an_integer_division_of_columns_agrees_where_columns_are_even() {
    let forward = |_: &crate::sample::Function, x: Tensor<4>| {
        let w = x.dims()[3];
        let (left, right) = (x.clone().slice(s![.., .., .., 0..w / 2]), x.slice(s![.., .., .., w / 2..w]));
        Tensor::cat(vec![right, left], 3)
    };
    Case { module: crate::sample::Function {}, inputs: image, forward, multiple: 2 }.agrees();
}

#[test]
fn a_graph_without_free_axes_agrees() {
    function_agrees(|_| floats([1, 3, 4, 6], 1), |x: Tensor<4>| (x.clone().mean_dim(3), x * 2.0));
}
