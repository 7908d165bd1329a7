//! A sensor that leans to one side.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// True direction = Rx(δ)·nominal direction: positive leans right. On ground the error goes with sin θ.
#[derive(Clone, Copy, Debug)]
pub(super) struct MountRoll;

impl Effect for MountRoll {
    fn about(&self) -> About {
        About {
            name: "mount_roll",
            does: "leans {roll_deg} farther to the {right|left} than the model mounts it",
            channel: Channel::Geometry,
            acts_on: ActsOn::ALL,
            covariates: &["azimuth", "elevation"],
            formula: "Rx(δ)·u",
            source: "extrinsic calibration on ground: Levinson and Thrun, Unsupervised calibration for multi-beam lasers (2010)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("roll_deg", 0.1, (-10.0, 10.0))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let roll = values.one(0).deg2rad();
        let (sin, cos) = (roll.clone().sin(), roll.cos());
        image.bend.turn(&image.rays, |[x, y, z]| {
            let left = y.clone() * cos.clone() - z.clone() * sin.clone();
            [x, left, y * sin + z * cos]
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
    fn a_fit_finds_the_roll() {
        Trial::of(Arc::new(MountRoll), &[0.3]).found_within(0.01);
    }
}
