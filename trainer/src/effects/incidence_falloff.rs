//! Surfaces that send less light back the more they are seen from the side.

use super::image::OtherAngle;
use super::incidence::{astray, log_cosine, strays, uniform};
use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// I·cosᵖ α: p = 1 is Lambert's law, p = 0 a sensor that undoes it. Of a surface whose angle the image does not show, or shows wrongly,
/// cosᵃ α is uniform: the mean of cosᵖ α is then a/(p + a), and that of its square a/(2p + a).
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
        vec![Parameter::free("exponent", 0.3, (-0.5, 5.0)), strays()]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let (log_cosine, variance) = log_cosine(&image.surface, &image.rays);
        let unknown = variance.greater_elem(0.0).float();
        let exponent = values.one(0).clamp(-0.6, 8.0);
        let a = uniform(&image.surface);
        let of_any = a.clone() / (a.clone() + exponent.clone());
        let of_any_square = a.clone() / (a + exponent.clone() * 2.0);
        let spread = (of_any_square - of_any.clone().square()).clamp_min(1e-10).sqrt();
        let seen = (log_cosine * exponent).exp();
        let mean = seen.clone() + (of_any.clone() - seen) * unknown.clone();
        let doubt = image.report.reflectance.clone() * spread.clone() * unknown;
        image.report.reflectance = image.report.reflectance * mean.clone();
        image.report.reflectance_sigma = (image.report.reflectance_sigma.square() + doubt.square()).sqrt();
        image.other_angle = Some(OtherAngle {
            share: astray(&image.surface, values.one(1)),
            factor: of_any / mean.clone(),
            spread: spread / mean,
        });
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_the_exponent_and_the_share_of_strays() {
        for exponent in [0.3, 1.0, 1.5] {
            Trial::of(Arc::new(IncidenceFalloff), &[exponent, 0.2]).each_within(&[0.02, 0.1]);
        }
    }
}
