//! The networks, and what every one of them gives.

pub mod blur;
pub mod border;
mod encoder;
mod generated;
mod layers;
pub mod norm;
pub mod patch_gan;
pub mod patch_nce;
pub mod range_code;
pub mod ray_drop;
mod relief;
mod residual;
pub mod resnet;
mod rings;
pub mod scatter;
mod unet;

use burn::tensor::Tensor;
use scatter::laplace;

pub use border::Border;
pub use generated::Generated;
pub use norm::NormKind;
pub use patch_gan::{PatchGan, PatchGanConfig};
pub use patch_nce::{PatchHeads, Places};
pub use range_code::{RangeCode, RangeCoder};
pub use resnet::{Output, Resnet, ResnetConfig};
pub use unet::{COLUMN_MULTIPLE, UNet, UNetConfig};

/// What the sensor measures, each `[batch, 1, ring, column]`, in physical units.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Range in metres, 0 where the simulation has no return.
    pub range_m: Tensor<4>,
    /// Reflectance, 0–1.
    pub reflectance: Tensor<4>,
    /// Probability that the sensor reports the ray.
    pub keep: Tensor<4>,
    /// Mean distance of reported reflectances from that one, where the network says it; they follow Laplace's distribution.
    pub scatter: Option<Tensor<4>>,
}

impl Measurement {
    /// The same with its reflectances drawn by uniform numbers from 0 to 1, `[batch, 1, ring, column]`, where they scatter.
    #[must_use]
    pub fn drawn(self, uniform: &Tensor<4>) -> Self {
        let drawn = |scale: Tensor<4>| (self.reflectance.clone() + laplace(uniform.clone()) * scale).clamp(0.0, 1.0);
        let reflectance = self.scatter.clone().map_or(self.reflectance.clone(), drawn);
        Self { reflectance, ..self }
    }
}

/// A [`Measurement`] before its last non-linearities, each `[batch, 1, ring, column]`.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// Natural logarithm of (range in metres + 1).
    pub log_range: Tensor<4>,
    /// Logit of the reflectance.
    pub reflectance_logit: Tensor<4>,
    /// Logit of the probability that the ray is reported.
    pub keep_logit: Tensor<4>,
    /// 1 where the simulation has a return, else 0.
    pub valid: Tensor<4>,
}
