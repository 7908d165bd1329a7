//! Wet ground, which mirrors the beam away at grazing incidence.

use burn::tensor::Tensor;

use super::surface::dot;
use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// keep·(1 − w·R) and I·(1 − d·R) on level surfaces, R = R₀ + (1 − R₀)(1 − cos α)⁵ being what a film of water reflects.
#[derive(Clone, Copy, Debug)]
pub(super) struct Specular;

/// Reflectance of water at normal incidence: ((n − 1)/(n + 1))² for n = 1.33.
const WATER: f64 = 0.02;

/// Squared cosine of a surface's slope below which it does not hold water, and from which it does: 35° and 25°.
const LEVEL: (f64, f64) = (0.67, 0.82);

impl Effect for Specular {
    fn about(&self) -> About {
        About {
            name: "specular",
            does: "loses light that wet ground mirrors away at grazing incidence: returns by {wetness} of the mirrored share, reflectance by {darkening} of it",
            channel: Channel::Missing,
            acts_on: ActsOn { range: false, reflectance: true, returns: true },
            covariates: &["incidence"],
            formula: "keep·(1 − w·R(α)), I·(1 − d·R(α)) on level surfaces",
            source: "Schlick, An Inexpensive BRDF Model for Physically-based Rendering (1994); wet ground: Hahner et al., LiDAR Snowfall Simulation (2022)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("wetness", 0.2, (0.0, 1.5)), Parameter::free("darkening", 0.2, (0.0, 1.5))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let surface = &image.surface;
        let up = surface.plane[2].clone().square() / dot(&surface.plane, &surface.plane).clamp_min(1e-12);
        let level = ((up - LEVEL.0) / (LEVEL.1 - LEVEL.0)).clamp(0.0, 1.0);
        let grazing = surface.cos_incidence.clone() * -1.0 + 1.0;
        let fifth = grazing.clone().square().square() * grazing;
        let mirrored = (fifth * (1.0 - WATER) + WATER) * level;
        let left = |share: Tensor<3>| (mirrored.clone() * share * -1.0 + 1.0).clamp_min(0.0);
        image.report.keep = image.report.keep * left(values.one(0)).clamp_max(1.0);
        image.report.reflectance = image.report.reflectance * left(values.one(1));
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_both_shares() {
        Trial::of(Arc::new(Specular), &[0.9, 0.6]).each_within(&[0.1, 0.1]);
    }
}
