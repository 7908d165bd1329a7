//! A U-Net on range images: what the papers call "learning from real".

use burn::module::{Module, Param};
use burn::nn::conv::{Conv2d, Conv2dConfig, ConvTranspose2d, ConvTranspose2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, Embedding, EmbeddingConfig, PaddingConfig2d};
use burn::tensor::activation::{relu, sigmoid};
use burn::tensor::{Device, Tensor, s};
use lidar::label::CLASSES;
use serde::{Deserialize, Serialize};

use super::{Measurement, Prediction};

/// Numbers a class is described by inside the network.
const CLASS_FEATURES: usize = 5;

/// Features of a pixel before the first convolution: range code, whether there is a return, reflectance, class.
const FEATURES: usize = 3 + CLASS_FEATURES;

/// Columns by which a whole turn is continued on either side before the first convolution, and cut off after the last: the network's
/// reach, so that its answer behind the sensor is as informed as ahead. A multiple of [`COLUMN_MULTIPLE`].
const WRAP: usize = 40;

/// The halvings in the network want a number of columns (and rings) that is a multiple of this.
pub const COLUMN_MULTIPLE: usize = 8;

/// Half the width of the range correction, in the natural logarithm of (range + 1 m).
const MAX_RANGE_CORRECTION: f32 = 0.05;

/// Size of a [`UNet`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UNetConfig {
    /// Channels at full, half, quarter and eighth resolution; multiples of 16 are fastest in ONNX Runtime.
    pub channels: [usize; 4],
}

impl Default for UNetConfig {
    fn default() -> Self {
        Self { channels: [16, 32, 64, 96] }
    }
}

/// The network. In: `[batch, 3, ring, column]` in physical units, as `proto::card::tensor` says; out: a [`Measurement`].
#[derive(Module, Debug)]
pub struct UNet {
    classes: Embedding,
    stem: Conv2d,
    /// What makes ring 7 differ from ring 8, `[1, channel, ring, 1]`: lasers differ in power, receivers in gain.
    ring: Param<Tensor<4>>,
    stem_norm: BatchNorm,
    level_0: Stage,
    down: Vec<Stage>,
    deep: Vec<Stage>,
    up: Vec<ConvTranspose2d>,
    merge: Vec<Stage>,
    head: Conv2d,
}

/// Convolution 3×3, batch norm, `ReLU`.
#[derive(Module, Debug)]
struct Stage {
    conv: Conv2d,
    norm: BatchNorm,
}

impl UNetConfig {
    /// A network with random weights for a sensor of `rings` rings.
    pub fn init(&self, rings: usize, device: &Device) -> UNet {
        let c = self.channels;
        let up = |from, to| ConvTranspose2dConfig::new([from, to], [2, 2]).with_stride([2, 2]).init(device);
        UNet {
            classes: EmbeddingConfig::new(CLASSES, CLASS_FEATURES).init(device),
            stem: conv3(FEATURES, c[0], 1, device),
            ring: Param::from_tensor(Tensor::zeros([1, c[0], rings, 1], device)),
            stem_norm: BatchNormConfig::new(c[0]).init(device),
            level_0: Stage::new(c[0], c[0], 1, device),
            down: (0..3).map(|i| Stage::new(c[i], c[i + 1], 2, device)).collect(),
            deep: (0..3).map(|i| Stage::new(c[i + 1], c[i + 1], 1, device)).collect(),
            up: (0..3).map(|i| up(c[3 - i], c[2 - i])).collect(),
            merge: (0..3).map(|i| Stage::new(2 * c[2 - i], c[2 - i], 1, device)).collect(),
            head: Conv2dConfig::new([c[0], 3], [1, 1]).init(device),
        }
    }
}

impl UNet {
    /// What the sensor measures of a whole turn: azimuth wraps round.
    ///
    /// `scan` is `[batch, 3, ring, column]` with a number of columns that is a multiple of [`COLUMN_MULTIPLE`] and at least 40.
    pub fn forward(&self, scan: Tensor<4>) -> Measurement {
        let columns = scan.dims()[3];
        let before = scan.clone().slice(s![.., .., .., columns - WRAP..columns]);
        let after = scan.clone().slice(s![.., .., .., 0..WRAP]);
        let wrapped = Tensor::cat(vec![before, scan, after], 3);
        let measured = self.predict(&wrapped).measure();
        let cut = |x: Tensor<4>| x.slice(s![.., .., .., WRAP..WRAP + columns]);
        Measurement {
            range_m: cut(measured.range_m),
            reflectance: cut(measured.reflectance),
            keep: cut(measured.keep),
            scatter: None,
        }
    }

    /// The same for a cut-out of a turn, before the last non-linearities: what the losses want.
    pub fn predict(&self, scan: &Tensor<4>) -> Prediction {
        let channel = |i: usize| scan.clone().slice(s![.., i..i + 1, .., ..]); // [batch, 1, ring, column]
        let range_m = channel(0);
        let valid = range_m.clone().greater_elem(0.0).float();
        // log₂(r + 1)/7 is 0 at the sensor and 1 at 127 m.
        let code = (range_m.clone() + 1.0).log() / (7.0 * std::f32::consts::LN_2);
        let features = Tensor::cat(vec![code, valid.clone(), channel(1), self.describe_classes(channel(2))], 1);

        let x = relu(self.stem_norm.forward(self.stem.forward(features) + self.ring.val()));
        let mut x = self.level_0.forward(x);
        let mut skips = Vec::with_capacity(3);
        for (down, deep) in self.down.iter().zip(&self.deep) {
            skips.push(x.clone());
            x = deep.forward(down.forward(x));
        }
        for (up, merge) in self.up.iter().zip(&self.merge) {
            let skip = skips.pop().unwrap_or_else(|| unreachable!("as many ways up as down"));
            x = merge.forward(Tensor::cat(vec![up.forward(x), skip], 1));
        }
        let head = self.head.forward(x); // [batch, 3, ring, column]
        let out = |i: usize| head.clone().slice(s![.., i..i + 1, .., ..]);
        Prediction {
            log_range: (range_m + 1.0).log() + out(0).tanh() * MAX_RANGE_CORRECTION,
            reflectance_logit: out(1),
            keep_logit: out(2),
            valid,
        }
    }

    /// The same network, in which a class that training never showed is described as unlabelled instead of by its random weights.
    #[must_use]
    pub fn forget_unseen_classes(mut self, seen: &[bool; CLASSES]) -> Self {
        let rows = |weight: Tensor<2>| {
            let row = |class: usize| if seen[class] { class } else { 0 };
            Tensor::cat((0..CLASSES).map(|class| weight.clone().slice(s![row(class)..row(class) + 1, ..])).collect(), 0)
        };
        self.classes.weight = self.classes.weight.map(rows);
        self
    }

    /// `[batch, 1, ring, column]` of class indices → `[batch, feature, ring, column]`.
    fn describe_classes(&self, class: Tensor<4>) -> Tensor<4> {
        let [batch, _, rings, columns] = class.dims();
        let index = class.clamp(0.0, (CLASSES - 1) as f32).int().reshape([batch, rings * columns]);
        let features = self.classes.forward(index); // [batch, ring · column, feature]
        features.swap_dims(1, 2).reshape([batch, CLASS_FEATURES, rings, columns])
    }
}

impl Prediction {
    /// Through the last non-linearities; what has no return in has none out.
    pub fn measure(self) -> Measurement {
        Measurement {
            range_m: (self.log_range.exp() - 1.0) * self.valid.clone(),
            reflectance: sigmoid(self.reflectance_logit) * self.valid.clone(),
            keep: sigmoid(self.keep_logit) * self.valid,
            scatter: None,
        }
    }
}

impl Stage {
    fn new(from: usize, to: usize, stride: usize, device: &Device) -> Self {
        Self { conv: conv3(from, to, stride, device), norm: BatchNormConfig::new(to).init(device) }
    }

    fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        relu(self.norm.forward(self.conv.forward(x)))
    }
}

/// A 3×3 convolution without bias (a norm follows), zero-padded by one pixel.
fn conv3(from: usize, to: usize, stride: usize, device: &Device) -> Conv2d {
    Conv2dConfig::new([from, to], [3, 3])
        .with_stride([stride, stride])
        .with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1))
        .with_bias(false)
        .init(device)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Distribution;

    fn scan(columns: usize, device: &Device) -> Tensor<4> {
        device.seed(3);
        let uniform = |top: f64| Tensor::<4>::random([1, 1, 16, columns], Distribution::Uniform(0.0, top), device);
        Tensor::cat(vec![uniform(80.0), uniform(1.0), uniform(19.9)], 1)
    }

    #[test]
    fn turning_the_sensor_turns_the_answer() {
        let device = Device::flex();
        let network = UNetConfig::default().init(16, &device);
        let turn = |x: Tensor<4>| {
            let columns = x.dims()[3];
            Tensor::cat(vec![x.clone().slice(s![.., .., .., 16..columns]), x.slice(s![.., .., .., 0..16])], 3)
        };
        let x = scan(128, &device);
        let difference = turn(network.forward(x.clone()).keep) - network.forward(turn(x)).keep;
        // Sums of the same numbers in the same order: only the order of blocks may differ.
        assert!(difference.abs().max().into_scalar::<f32>() < 1e-5);
    }

    #[test]
    fn an_unseen_class_counts_as_unlabelled_and_a_seen_one_as_itself() {
        let device = Device::flex();
        let mut seen = [true; CLASSES];
        seen[7] = false;
        let network = UNetConfig::default().init(16, &device).forget_unseen_classes(&seen);
        let keep = |class: f32| {
            let scan = Tensor::cat(
                vec![Tensor::<4>::full([1, 2, 16, 64], 0.5, &device), Tensor::full([1, 1, 16, 64], class, &device)],
                1,
            );
            network.forward(scan).keep
        };
        let differs = |class: f32| (keep(class) - keep(0.0)).abs().max().into_scalar::<f32>() > 1e-6;
        assert!(!differs(7.0));
        assert!(differs(8.0));
    }

    #[test]
    fn what_has_no_return_in_has_none_out() {
        let device = Device::flex();
        let network = UNetConfig::default().init(16, &device);
        let measured = network.forward(Tensor::zeros([1, 3, 16, 64], &device));
        for x in [measured.range_m, measured.reflectance, measured.keep] {
            assert_eq!(x.abs().max().into_scalar::<f32>(), 0.0);
        }
    }
}
