//! Noise that grows with range, as the signal fades.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// σ² = σ₀² + (σ₁·r)², σ₀ being the noise floor's.
#[derive(Clone, Copy, Debug)]
pub(super) struct RangeNoise;

impl Effect for RangeNoise {
    fn about(&self) -> About {
        About {
            name: "range_noise",
            does: "measures ranges with noise that grows by {sigma_per_m} a metre",
            channel: Channel::RangeVariance,
            acts_on: ActsOn::RANGE,
            covariates: &["range"],
            formula: "σ² = σ₀² + (σ₁·r)²",
            source: "Kilic et al., Lidar Light Scattering Augmentation (2021): σ ∝ 1/√SNR, the signal falling as 1/r²",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::positive("sigma_per_m", 5e-4, (1e-6, 0.1))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let grown = image.surface.range_m.clone() * values.one(0);
        image.report.range_sigma_m = (image.report.range_sigma_m.square() + grown.square()).sqrt();
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_how_noise_grows() {
        for sigma_per_m in [5e-4, 3e-3] {
            Trial::of(Arc::new(RangeNoise), &[sigma_per_m]).found_within(1e-4);
        }
    }
}
