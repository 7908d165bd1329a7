//! A sensor that is higher or lower than it is said to be.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// True origin = nominal origin + h·z. On level ground every range grows by the same share, h over the sensor's height.
#[derive(Clone, Copy, Debug)]
pub(super) struct MountHeight;

impl Effect for MountHeight {
    fn about(&self) -> About {
        About {
            name: "mount_height",
            does: "is mounted {offset_m} {higher|lower} than the model says",
            channel: Channel::Geometry,
            acts_on: ActsOn::ALL,
            covariates: &["elevation"],
            formula: "o + h·z",
            source: "extrinsic calibration on ground: Levinson and Thrun, Unsupervised calibration for multi-beam lasers (2010)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("offset_m", 0.05, (-1.0, 1.0))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let up = values.one(0);
        let still = up.zeros_like();
        image.bend.shift([still.clone(), still, up]);
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_the_height() {
        Trial::of(Arc::new(MountHeight), &[-0.06]).found_within(0.01);
    }
}
