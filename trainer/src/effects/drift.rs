//! Range and gain that change while the sensor runs.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// r + b·n and (1 + g·n)·I in frame n of a recording, so the first frame is as the model says; an exported model, which sees single scans,
/// stands for that frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drift;

impl Effect for Drift {
    fn about(&self) -> About {
        About {
            name: "drift",
            does: "changes while it runs: ranges by {range_m_per_frame} m a frame, and reflectance by a share of {gain_per_frame}",
            channel: Channel::Range,
            acts_on: ActsOn { range: true, reflectance: true, returns: false },
            covariates: &["frame"],
            formula: "r + b·n, (1 + g·n)·I",
            source: "warm-up of lidars, here to first order: Glennie and Lichti, Temporal Stability of the Velodyne HDL-64E S2 (2011)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::free("range_m_per_frame", 0.002, (-0.1, 0.1)),
            Parameter::free("gain_per_frame", 0.002, (-0.05, 0.05)),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let gain = image.frame.clone() * values.one(1) + 1.0;
        image.report.range_m = image.report.range_m + image.frame.clone() * values.one(0);
        image.report.reflectance = image.report.reflectance * gain;
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_both_slopes() {
        Trial::of(Arc::new(Drift), &[0.03, -0.04]).each_within(&[0.001, 0.001]);
    }
}
