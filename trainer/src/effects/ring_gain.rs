//! Receivers that amplify differently: stripes in the reflectance.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// `g_k·I + o_k` for every ring k.
#[derive(Clone, Copy, Debug)]
pub(super) struct RingGain;

impl Effect for RingGain {
    fn about(&self) -> About {
        About {
            name: "ring_gain",
            does: "reports reflectance with a gain of its own on every ring",
            channel: Channel::Reflectance,
            acts_on: ActsOn::REFLECTANCE,
            covariates: &["ring"],
            formula: "g_k·I + o_k",
            source: "Levinson and Thrun, Unsupervised calibration for multi-beam lasers (2010); layer factors 0.49–1.85 in FZD's sensor models",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::free("gain", 0.1, (0.05, 5.0)).from(1.0).per_ring(),
            Parameter::free("offset", 0.02, (-0.5, 0.5)).per_ring(),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        image.report.reflectance = image.report.reflectance * values.per_ring(0) + values.per_ring(1);
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_every_ring() {
        let mut truth: Vec<f64> = (0..16).map(|k| 0.7 + 0.04 * f64::from(k)).collect();
        truth.extend((0..16).map(|k| 0.02 - 0.003 * f64::from(k)));
        Trial::of(Arc::new(RingGain), &truth).found_within(0.1);
    }
}
