//! Surfaces that send less light back the more they are seen from the side.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// I·cosᵖ α: p = 1 is Lambert's law, p = 0 a sensor that undoes it.
#[derive(Clone, Copy, Debug)]
pub(super) struct IncidenceFalloff;

impl Effect for IncidenceFalloff {
    fn about(&self) -> About {
        About {
            name: "incidence_falloff",
            does: "reports less reflectance the more a surface is seen from the side, as the cosine to the power of {exponent}",
            channel: Channel::Reflectance,
            acts_on: ActsOn::REFLECTANCE,
            covariates: &["incidence"],
            formula: "I·cosᵖ α",
            source: "Kaasalainen et al., Analysis of Incidence Angle and Distance Effects on TLS Intensity (Remote Sensing, 2011); Lambert, Phong",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("exponent", 0.3, (-2.0, 5.0))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let log = image.surface.cos_incidence.clone().log() * values.one(0);
        image.report.reflectance = image.report.reflectance * log.clamp(-20.0, 20.0).exp();
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_the_exponent() {
        for exponent in [0.3, 1.0, 1.5] {
            Trial::of(Arc::new(IncidenceFalloff), &[exponent]).found_within(0.02);
        }
    }
}
