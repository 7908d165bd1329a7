//! What keeps the features of a layer in bounds.

use burn::module::Module;
use burn::nn::{BatchNorm, BatchNormConfig, InstanceNorm, InstanceNormConfig};
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

/// Which norm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NormKind {
    /// Each channel of each image by itself, without weights: the paper's.
    #[default]
    Instance,
    /// Each channel of all images together; at inference it is part of the convolution before it.
    Batch,
}

/// A norm over `[batch, channel, ring, column]`.
#[derive(Module, Debug)]
pub enum Norm {
    /// See [`NormKind::Instance`].
    Instance(InstanceNorm),
    /// See [`NormKind::Batch`].
    Batch(BatchNorm),
}

impl NormKind {
    /// A norm of so many channels.
    pub fn init(self, channels: usize, device: &Device) -> Norm {
        match self {
            Self::Instance => Norm::Instance(InstanceNormConfig::new(channels).with_affine(false).init(device)),
            Self::Batch => Norm::Batch(BatchNormConfig::new(channels).init(device)),
        }
    }
}

impl Norm {
    /// Normalised.
    pub fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        match self {
            Self::Instance(norm) => norm.forward(x),
            Self::Batch(norm) => norm.forward(x),
        }
    }
}
