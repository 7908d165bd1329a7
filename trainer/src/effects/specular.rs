//! Wet ground, which mirrors the beam away at grazing incidence.

use burn::tensor::Tensor;

use super::incidence::on_wet_ground;
use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// keep·(1 − w·R) and I·(1 − d·R) on sealed ground (where water soaks away, nothing happens), R being what a film of water reflects of
/// unpolarised light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Specular;

/// Refractive index of water.
const WATER: f64 = 1.33;

impl Effect for Specular {
    fn about(&self) -> About {
        About {
            name: "specular",
            does: "loses light that wet ground mirrors away at grazing incidence: returns by {wetness} of the mirrored share, reflectance by {darkening} of it",
            channel: Channel::Missing,
            acts_on: ActsOn { range: false, reflectance: true, returns: true },
            covariates: &["incidence"],
            formula: "keep·(1 − w·R(α)), I·(1 − d·R(α)) on sealed ground",
            source: "Fresnel's equations: Born and Wolf, Principles of Optics, 1.5; wet ground: Hahner et al., LiDAR Snowfall Simulation (2022)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("wetness", 0.2, (0.0, 1.5)), Parameter::free("darkening", 0.2, (0.0, 1.5))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let (cosine, wet) = on_wet_ground(&image);
        let mirrored = fresnel(&cosine) * wet;
        let left = |share: Tensor<3>| (mirrored.clone() * share * -1.0 + 1.0).clamp_min(0.0);
        image.report.keep = image.report.keep * left(values.one(0)).clamp_max(1.0);
        image.report.reflectance = image.report.reflectance * left(values.one(1));
        image
    }
}

/// Share of unpolarised light that water reflects, by the cosine of the angle of incidence: Fresnel's equations.
fn fresnel(cosine: &Tensor<3>) -> Tensor<3> {
    // n times the cosine of the angle of refraction, by Snell's law.
    let refracted = (cosine.clone().square() + (WATER * WATER - 1.0)).sqrt();
    let reflected = |a: Tensor<3>, b: Tensor<3>| ((a.clone() - b.clone()) / (a + b)).square();
    let across = reflected(cosine.clone(), refracted.clone());
    let along = reflected(cosine.clone() * (WATER * WATER), refracted);
    (across + along) * 0.5
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn water_mirrors_two_percent_from_above_and_all_at_grazing_incidence() {
        let cosine = Tensor::<1>::from_floats([1.0, 0.5, 1e-6], &burn::tensor::Device::flex()).reshape([1, 1, 3]);
        let mirrored: Vec<f32> = fresnel(&cosine).into_data().iter().collect();
        // At 60°, refracted to 40.63°: sin² 19.37°/sin² 100.63° = 0.1139 across and tan² 19.37°/tan² 100.63° = 0.0044 along.
        for (mirrored, expected) in mirrored.iter().zip([0.0201, 0.0591, 1.0]) {
            assert!((mirrored - expected).abs() < 2e-4, "{mirrored} for {expected}");
        }
    }

    #[test]
    fn a_fit_finds_both_shares() {
        Trial::of(Arc::new(Specular), &[0.9, 0.6]).each_within(&[0.1, 0.1]);
    }
}
