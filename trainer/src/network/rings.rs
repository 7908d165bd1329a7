//! What a convolution cannot know: which ring it is at.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};

use super::resnet::ResnetConfig;

/// What makes ring 7 differ from ring 8: lasers differ in power, receivers in gain.
#[derive(Module, Debug)]
pub(super) struct Rings {
    /// Added to the features of the first convolution, `[1, channel, ring, 1]`.
    pub(super) stem: Param<Tensor<4>>,
    /// Added to what the last one says, `[1, channel, ring, 1]`.
    pub(super) head: Param<Tensor<4>>,
}

impl Rings {
    /// None differs to begin with.
    pub(super) fn new(config: &ResnetConfig, device: &Device) -> Self {
        let zeros = |channels| Param::from_tensor(Tensor::zeros([1, channels, config.rings, 1], device));
        Self { stem: zeros(config.width), head: zeros(config.said()) }
    }
}
