//! A sensor that looks down or up.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// True direction = Ry(δ)·nominal direction: positive looks down ahead and up behind. On ground the error goes with cos θ.
#[derive(Clone, Copy, Debug)]
pub(super) struct MountPitch;

impl Effect for MountPitch {
    fn about(&self) -> About {
        About {
            name: "mount_pitch",
            does: "looks {pitch_deg} farther {down|up} ahead than the model mounts it",
            channel: Channel::Geometry,
            acts_on: ActsOn::ALL,
            covariates: &["azimuth", "elevation"],
            formula: "Ry(δ)·u",
            source: "extrinsic calibration on ground: Levinson and Thrun, Unsupervised calibration for multi-beam lasers (2010)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("pitch_deg", 0.1, (-10.0, 10.0))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let pitch = values.one(0).deg2rad();
        let (sin, cos) = (pitch.clone().sin(), pitch.cos());
        image.bend.turn(&image.rays, |[x, y, z]| {
            let ahead = x.clone() * cos.clone() + z.clone() * sin.clone();
            [ahead, y, z * cos - x * sin]
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
    fn a_fit_finds_the_pitch() {
        Trial::of(Arc::new(MountPitch), &[-0.3]).found_within(0.01);
    }
}
