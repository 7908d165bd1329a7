//! Rain, snow or spray that returns light before the target does.

use burn::tensor::Tensor;

use super::{About, ActsOn, Channel, Effect, Extra, Image, Parameter, Place, Values};

/// Drops are hit at a rate of c·e^{−x/ℓ} a metre: the farther a drop the more often it is too faint. Between the sensor's nearest range x₀
/// and a target at r, one is seen with probability 1 − exp(−c·ℓ·(e^{−x₀/ℓ} − e^{−r/ℓ})).
#[derive(Clone, Copy, Debug)]
pub(super) struct Precipitation;

/// Mean reflectance of a drop.
const REFLECTANCE: f64 = 0.02;

impl Effect for Precipitation {
    fn about(&self) -> About {
        About {
            name: "precipitation",
            does: "sees something in the air before its target, with a probability of {probability_per_m} a metre near by that falls by e every {reach_m} m",
            channel: Channel::Extra,
            acts_on: ActsOn { range: true, reflectance: false, returns: true },
            covariates: &["range"],
            formula: "p = 1 − exp(−c·ℓ·(e^{−x₀/ℓ} − e^{−r/ℓ})), density ∝ e^{−x/ℓ}",
            source: "Rasshofer, Spies and Spies, Influences of weather phenomena on automotive laser radar systems (2011); Hasirlioglu and Riener, A Model-Based Approach to Simulate Rain Effects on Automotive Surround Sensor Data (2018)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::positive("probability_per_m", 1e-5, (1e-7, 0.5)),
            Parameter::positive("reach_m", 8.0, (0.3, 200.0)),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let (from_m, to_m) = image.rays.limits_m;
        let (rate, reach_m) = (values.one(0), values.one(1));
        let none = reach_m.clone() * 0.0;
        let empty = image.surface.hit.clone().lower_elem(0.5);
        let to_m = image.surface.range_m.clone().mask_fill(empty, to_m);
        let beyond = |x: Tensor<3>| (x / reach_m.clone() * -1.0).exp();
        let within = beyond(none.clone() + from_m) - beyond(to_m.clone().clamp_min(from_m));
        image.extra.push(Extra {
            probability: (within * (rate * reach_m.clone()) * -1.0).exp() * -1.0 + 1.0,
            place: Place::Exponential { from_m: none.clone() + from_m, scale_m: reach_m, to_m },
            reflectance: none + REFLECTANCE,
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
    fn a_fit_finds_rate_and_reach() {
        Trial::of(Arc::new(Precipitation), &[0.005, 6.0]).each_within(&[0.001, 1.0]);
    }
}
