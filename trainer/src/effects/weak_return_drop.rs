//! Returns too weak to be detected.

use burn::tensor::Tensor;

use super::draw::cumulative;
use super::incidence::{astray, log_cosine, strays, uniform};
use super::{About, ActsOn, Channel, Effect, Evidence, Image, Parameter, Rays, Surface, Values};

/// keep · Φ((ln P − ln P₀)/s), with P = ρ·cos α·e^{−2βr}/r² the power of a Lambertian target that fills the beam.
#[derive(Clone, Copy, Debug)]
pub(super) struct WeakReturnDrop;

/// Surfaces darker than this are taken to be as dark, so that the power has a logarithm.
const DARKEST: f32 = 1e-3;

impl Effect for WeakReturnDrop {
    fn about(&self) -> About {
        About {
            name: "weak_return_drop",
            does: "loses returns of dark, slanted or far surfaces: every other one at a received power ρ·cos α/r² of {p_min_per_m2} per m²",
            channel: Channel::Missing,
            acts_on: ActsOn::RETURNS,
            covariates: &["range", "incidence", "reflectance"],
            formula: "keep · Φ((ln(ρ·cos α·e^{−2βr}/r²) − ln P₀)/s)",
            source: "lidar equation with a detection threshold: Kilic et al., LISA (2021); Wagner et al., ISPRS J. 60 (2006)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::positive("p_min_per_m2", 1e-9, (1e-9, 1.0)),
            Parameter::positive("softness", 0.5, (0.02, 5.0)),
            Parameter::free("beta_per_m", 0.002, (-0.005, 0.1)),
            strays(),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let here = detected(values, &image.surface, &image.rays);
        let detected = match (&image.other, image.beside()) {
            (Some(other), Some(beside)) => {
                here.clone() + (detected(values, &other.surface, &image.rays) - here) * beside
            }
            _ => here,
        };
        image.report.keep = image.report.keep * detected;
        image
    }

    fn starts(&self, evidence: &Evidence) -> Vec<Vec<f64>> {
        let power = |i: usize| {
            let range_m = evidence.range_m[i].max(0.1);
            evidence.surface_reflectance[i].max(DARKEST) * evidence.cos_incidence[i] / (range_m * range_m)
        };
        let hit = evidence.pixels().filter(|i| evidence.range_m[*i] > 0.0);
        let powers: Vec<f32> = hit.map(power).collect();
        let thresholds = [0.005, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9];
        let thresholds = thresholds.iter().filter_map(|q| Evidence::quantile(powers.iter().copied(), *q));
        let candidates =
            thresholds.flat_map(|p_min| [0.1, 0.4, 1.5].map(|softness| vec![p_min, softness, 0.0, strays().start]));
        let detected = |candidate: &[f64], i: usize| {
            let z = (f64::from(power(i)) / candidate[0]).ln() / candidate[1];
            // The logistic function of 1.702 z is within 0.01 of the normal distribution function (Haley 1952).
            1.0 / (1.0 + (-1.702 * z).exp())
        };
        evidence.likeliest(candidates, detected).into_iter().collect()
    }
}

/// Probability that a return of a surface is strong enough.
fn detected(values: &Values, surface: &Surface, rays: &Rays) -> Tensor<3> {
    let range_m = surface.range_m.clone().clamp_min(0.1);
    let (log_cosine, variance) = log_cosine(surface, rays);
    let power = (surface.reflectance.clone().clamp_min(DARKEST) / range_m.clone().square()).log();
    let above = power - range_m * values.one(2) * 2.0 - values.one(0).log();
    // Averaged over a normal ln cos α, the normal distribution function is one again, only wider.
    let softness = |variance: Tensor<3>| (variance + values.one(1).square()).sqrt();
    let any = uniform(surface).recip();
    let at_any = (above.clone() - any.clone()) / softness(any.square());
    let as_seen = cumulative(&((above + log_cosine) / softness(variance)));
    as_seen.clone() + (cumulative(&at_any) - as_seen) * astray(surface, values.one(3))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_the_weakest_power() {
        let trial = Trial::of(Arc::new(WeakReturnDrop), &[1e-4, 0.4, 0.0, 0.3]);
        trial.each_within(&[2e-5, 0.1, 0.004, 0.4]);
    }
}
