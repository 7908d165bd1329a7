//! A clock that runs too fast or too slow: ranges that are off by a constant factor.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// (1 + s)·r.
#[derive(Clone, Copy, Debug)]
pub(super) struct RangeScale;

impl Effect for RangeScale {
    fn about(&self) -> About {
        About {
            name: "range_scale",
            does: "reports ranges that are by {scale} of themselves too {long|short}",
            channel: Channel::Range,
            acts_on: ActsOn::RANGE,
            covariates: &["range"],
            formula: "(1 + s)·r",
            source: "Glennie and Lichti, Static Calibration and Analysis of the Velodyne HDL-64E S2 (Remote Sensing, 2010), equation 1",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("scale", 0.003, (-0.1, 0.1))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        image.report.range_m = image.report.range_m * (values.one(0) + 1.0);
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_the_scale() {
        for scale in [0.003, -0.01] {
            Trial::of(Arc::new(RangeScale), &[scale]).found_within(2e-4);
        }
    }
}
