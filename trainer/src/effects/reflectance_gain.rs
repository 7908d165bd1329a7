//! A receiver that amplifies all rings alike.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// g·I + o.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReflectanceGain;

impl Effect for ReflectanceGain {
    fn about(&self) -> About {
        About {
            name: "reflectance_gain",
            does: "reports reflectance times {gain}, plus {offset}",
            channel: Channel::Reflectance,
            acts_on: ActsOn::REFLECTANCE,
            covariates: &["reflectance"],
            formula: "g·I + o",
            source: "radiometric calibration by a line: Höfle and Pfeifer, Correction of Laser Scanning Intensity Data (ISPRS Journal, 2007)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("gain", 0.1, (0.05, 5.0)).from(1.0), Parameter::free("offset", 0.02, (-0.5, 0.5))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        image.report.reflectance = image.report.reflectance * values.one(0) + values.one(1);
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_gain_and_offset() {
        for truth in [[0.6, 0.02], [1.3, -0.05]] {
            Trial::of(Arc::new(ReflectanceGain), &truth).found_within(0.01);
        }
    }
}
