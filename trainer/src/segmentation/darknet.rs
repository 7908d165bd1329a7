//! The network: a darknet on range images, as `RangeNet++` has it, small.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig, ConvTranspose2d, ConvTranspose2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig};
use burn::tensor::activation::leaky_relu;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use super::classes::CLASSES;
use super::input::CHANNELS;
use crate::network::Border;

/// Slope of the rectifiers below zero, darknet's.
const LEAK: f64 = 0.1;

/// Rings and columns that become one on the way down, level by level: columns first, since there are many more of them.
const STRIDES: [[usize; 2]; 4] = [[1, 2], [2, 2], [2, 2], [2, 2]];

/// What the number of rings has to be a multiple of.
pub const RING_MULTIPLE: usize = 8;

/// What the number of columns has to be a multiple of.
pub const COLUMN_MULTIPLE: usize = 16;

/// Size of a [`Darknet`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DarknetConfig {
    /// Channels at full size and at each level below; even numbers.
    pub channels: [usize; 5],
}

impl Default for DarknetConfig {
    fn default() -> Self {
        Self { channels: [16, 24, 32, 48, 64] }
    }
}

/// What a [`Darknet`] is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Channels of what it is shown.
    pub seen: usize,
    /// Channels of what it says.
    pub said: usize,
    /// Rows and columns that become one on the way down, level by level.
    pub strides: [[usize; 2]; 4],
}

/// The network. In: `[batch, channel, ring, column]`, of range images see [`input`](super::input); out as many rings and columns, of range
/// images a logit a class.
#[derive(Module, Debug)]
pub struct Darknet {
    stem: Stage,
    down: Vec<Down>,
    up: Vec<Up>,
    head: Conv2d,
}

/// Convolution, batch norm, leaky `ReLU`.
#[derive(Module, Debug)]
struct Stage {
    conv: Conv2d,
    norm: BatchNorm,
    #[module(skip)]
    padding: usize,
}

/// x + conv 3×3 to all channels of conv 1×1 to half of them (x).
#[derive(Module, Debug)]
struct Block {
    narrow: Stage,
    wide: Stage,
}

/// To the next smaller size.
#[derive(Module, Debug)]
struct Down {
    halve: Stage,
    block: Block,
}

/// Back to the next larger size, where what was there on the way down is added.
#[derive(Module, Debug)]
struct Up {
    double: ConvTranspose2d,
    norm: BatchNorm,
    block: Block,
}

impl DarknetConfig {
    /// A network with random weights that tells the classes of range images.
    pub fn init(&self, device: &Device) -> Darknet {
        self.shaped(Shape { seen: CHANNELS, said: CLASSES, strides: STRIDES }, device)
    }

    /// A network with random weights for other images.
    pub fn shaped(&self, Shape { seen, said, strides }: Shape, device: &Device) -> Darknet {
        let c = self.channels;
        let down = |i: usize| Down {
            halve: Stage::new([c[i], c[i + 1]], 3, strides[i], device),
            block: Block::new(c[i + 1], device),
        };
        let up = |i: usize| Up {
            double: ConvTranspose2dConfig::new([c[i + 1], c[i]], strides[i]).with_stride(strides[i]).init(device),
            norm: BatchNormConfig::new(c[i]).init(device),
            block: Block::new(c[i], device),
        };
        Darknet {
            stem: Stage::new([seen, c[0]], 3, [1, 1], device),
            down: (0..strides.len()).map(down).collect(),
            up: (0..strides.len()).rev().map(up).collect(),
            head: Conv2dConfig::new([c[0], said], [1, 1]).init(device),
        }
    }
}

impl Darknet {
    /// A logit a class.
    pub fn forward(&self, scan: Tensor<4>, border: Border) -> Tensor<4> {
        let mut levels = self.levels(scan, border);
        let mut x = levels.pop().unwrap_or_else(|| unreachable!("the bottleneck is a level"));
        for (up, beside) in self.up.iter().zip(levels.into_iter().rev()) {
            x = up.block.forward(leaky_relu(up.norm.forward(up.double.forward(x)), LEAK) + beside, border);
        }
        self.head.forward(x)
    }

    /// The features at the smallest size, `[batch, channel, ring / 8, column / 16]`.
    pub fn bottleneck(&self, scan: Tensor<4>, border: Border) -> Tensor<4> {
        self.levels(scan, border).pop().unwrap_or_else(|| unreachable!("the bottleneck is a level"))
    }

    /// The features at every size, the largest first.
    fn levels(&self, scan: Tensor<4>, border: Border) -> Vec<Tensor<4>> {
        let mut x = self.stem.forward(scan, border);
        let mut levels = Vec::with_capacity(1 + self.down.len());
        for down in &self.down {
            levels.push(x.clone());
            x = down.block.forward(down.halve.forward(x, border), border);
        }
        levels.push(x);
        levels
    }
}

impl Stage {
    fn new(channels: [usize; 2], size: usize, stride: [usize; 2], device: &Device) -> Self {
        let conv = Conv2dConfig::new(channels, [size, size]).with_stride(stride).with_bias(false);
        Self { conv: conv.init(device), norm: BatchNormConfig::new(channels[1]).init(device), padding: size / 2 }
    }

    fn forward(&self, x: Tensor<4>, border: Border) -> Tensor<4> {
        let x = if self.padding > 0 { border.pad(x, self.padding) } else { x };
        leaky_relu(self.norm.forward(self.conv.forward(x)), LEAK)
    }
}

impl Block {
    fn new(channels: usize, device: &Device) -> Self {
        let half = channels / 2;
        Self {
            narrow: Stage::new([channels, half], 1, [1, 1], device),
            wide: Stage::new([half, channels], 3, [1, 1], device),
        }
    }

    fn forward(&self, x: Tensor<4>, border: Border) -> Tensor<4> {
        x.clone() + self.wide.forward(self.narrow.forward(x, border), border)
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Distribution, s};

    use super::*;

    #[test]
    fn turning_the_sensor_turns_the_classes() {
        let device = Device::flex();
        device.seed(4);
        let network = DarknetConfig { channels: [4, 4, 6, 8, 8] }.init(&device);
        let scan = Tensor::<4>::random([2, CHANNELS, 16, 96], Distribution::Uniform(0.0, 1.0), &device);
        let turn = |x: Tensor<4>| {
            Tensor::cat(vec![x.clone().slice(s![.., .., .., 32..96]), x.slice(s![.., .., .., 0..32])], 3)
        };
        let logits = network.forward(scan.clone(), Border::Turn);
        assert_eq!(logits.dims(), [2, CLASSES, 16, 96]);
        // By multiples of 16 columns, that is: a halving falls on every other column.
        let difference = turn(logits) - network.forward(turn(scan), Border::Turn);
        assert!(difference.abs().max().into_scalar::<f32>() < 1e-5);
    }

    #[test]
    fn the_bottleneck_is_an_eighth_as_high_and_a_sixteenth_as_wide() {
        let device = Device::flex();
        let network = DarknetConfig::default().init(&device);
        let features = network.bottleneck(Tensor::zeros([1, CHANNELS, 64, 128], &device), Border::Turn);
        assert_eq!(features.dims(), [1, 64, 8, 8]);
        // Half a megabyte: what ships has to be small.
        assert!(network.num_params() < 150_000, "{}", network.num_params());
    }
}
