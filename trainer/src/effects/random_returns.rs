//! Returns that have nothing to do with the scene.

use super::{About, ActsOn, Channel, Effect, Evidence, Extra, Image, Parameter, Place, Values};

/// With probability p any ray, also one that hits nothing, reports a range that is uniform between the sensor's limits.
#[derive(Clone, Copy, Debug)]
pub(super) struct RandomReturns;

/// Mean reflectance of such a return: detector noise and other sensors' light are faint.
const REFLECTANCE: f64 = 0.1;

impl Effect for RandomReturns {
    fn about(&self) -> About {
        About {
            name: "random_returns",
            does: "reports a random range on a share of {probability} of its rays, wherever they go",
            channel: Channel::Extra,
            acts_on: ActsOn { range: true, reflectance: false, returns: true },
            covariates: &[],
            formula: "p, r uniform between the limits",
            source: "the p_rand of beam models: Thrun, Burgard and Fox, Probabilistic Robotics (2005), 6.3; Kim et al., Mutual Interference between Automotive LIDAR Scanners (2015)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::probability("probability", 1e-4, (1e-7, 0.3))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let none = values.one(0) * 0.0;
        let (from_m, to_m) = image.rays.limits_m;
        image.extra.push(Extra {
            probability: values.one(0),
            place: Place::Uniform { from_m: none.clone() + from_m, to_m: none.clone() + to_m },
            reflectance: none + REFLECTANCE,
        });
        image
    }

    /// The rate on rays that hit nothing: on the others, outliers of the noise floor explain as much.
    fn starts(&self, evidence: &Evidence) -> Vec<Vec<f64>> {
        let empty: Vec<usize> = evidence.pixels().filter(|i| evidence.range_m[*i] <= 0.0).collect();
        let returns = empty.iter().filter(|i| evidence.returned(**i)).count();
        if returns == 0 {
            return vec![];
        }
        vec![vec![(returns as f64 / empty.len() as f64).clamp(1e-5, 0.3)]]
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_how_many() {
        Trial::of(Arc::new(RandomReturns), &[0.03]).each_within(&[0.01]);
    }
}
