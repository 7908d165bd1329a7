//! Ranges that are too long or too short by a constant.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// r + b for every ray alike.
#[derive(Clone, Copy, Debug)]
pub(super) struct RangeOffset;

/// `r + b_k` for every ring k.
#[derive(Clone, Copy, Debug)]
pub(super) struct RangeOffsetPerRing;

const SOURCE: &str =
    "Glennie and Lichti, Static Calibration and Analysis of the Velodyne HDL-64E S2 (Remote Sensing, 2010), equation 1";

impl Effect for RangeOffset {
    fn about(&self) -> About {
        About {
            name: "range_offset",
            does: "reports ranges that are {offset_m} too {long|short}",
            channel: Channel::Range,
            acts_on: ActsOn::RANGE,
            covariates: &[],
            formula: "r + b",
            source: SOURCE,
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("offset_m", 0.03, (-1.0, 1.0))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        image.report.range_m = image.report.range_m + values.one(0);
        image
    }
}

impl Effect for RangeOffsetPerRing {
    fn about(&self) -> About {
        About {
            name: "range_offset_per_ring",
            does: "reports ranges with an offset of its own on every ring",
            channel: Channel::Range,
            acts_on: ActsOn::RANGE,
            covariates: &["ring"],
            formula: "r + b_k",
            source: SOURCE,
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("offset_m", 0.03, (-1.0, 1.0)).per_ring()]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        image.report.range_m = image.report.range_m + values.per_ring(0);
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_the_offset() {
        for offset_m in [0.04, -0.3] {
            Trial::of(Arc::new(RangeOffset), &[offset_m]).found_within(0.002);
        }
    }

    #[test]
    fn a_fit_finds_the_offset_of_every_ring() {
        let truth: Vec<f64> = (0..16).map(|k| 0.08 * f64::from(k).sin()).collect();
        Trial::of(Arc::new(RangeOffsetPerRing), &truth).found_within(0.005);
    }
}
