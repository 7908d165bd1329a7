//! A sensor that looks to one side.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// True direction = Rz(δ)·nominal direction: positive looks left. Nothing changes on ground.
#[derive(Clone, Copy, Debug)]
pub(super) struct MountYaw;

impl Effect for MountYaw {
    fn about(&self) -> About {
        About {
            name: "mount_yaw",
            does: "looks {yaw_deg} farther to the {left|right} than the model mounts it",
            channel: Channel::Geometry,
            acts_on: ActsOn::ALL,
            covariates: &["azimuth"],
            formula: "θ + δ",
            source: "extrinsic calibration: Levinson and Thrun, Unsupervised calibration for multi-beam lasers (2010)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("yaw_deg", 0.1, (-15.0, 15.0))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        image.bend.left(values.one(0).deg2rad());
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_the_yaw() {
        Trial::of(Arc::new(MountYaw), &[0.5]).found_within(0.02);
    }
}
