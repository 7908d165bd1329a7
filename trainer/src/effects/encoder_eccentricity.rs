//! An encoder whose disc sits off its axis or is oval: azimuths that swing around the reported ones once or twice a turn.

use burn::tensor::Tensor;

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// θ + a·sin(θ + b) + a₂·sin(2θ + b₂), fitted as the linear sum of sines and cosines, which has a gradient at nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct EncoderEccentricity;

impl Effect for EncoderEccentricity {
    fn about(&self) -> About {
        About {
            name: "encoder_eccentricity",
            does: "reports azimuths that swing around the true ones once or twice a turn",
            channel: Channel::Geometry,
            acts_on: ActsOn::ALL,
            covariates: &["azimuth"],
            formula: "θ + s·sin θ + c·cos θ + s₂·sin 2θ + c₂·cos 2θ",
            source: "circle eccentricity and wobble among the parameters of Lichti, Error modelling, calibration and analysis of an AM–CW terrestrial laser scanner system (2007)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        ["sin_deg", "cos_deg", "sin2_deg", "cos2_deg"].map(|name| Parameter::free(name, 0.1, (-3.0, 3.0))).to_vec()
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let once = image.rays.azimuth_rad.clone();
        let twice = once.clone() * 2.0;
        let waves: [Tensor<3>; 4] = [once.clone().sin(), once.cos(), twice.clone().sin(), twice.cos()];
        for (i, wave) in waves.into_iter().enumerate() {
            image.bend.left(wave * values.one(i).deg2rad());
        }
        image
    }

    fn derived(&self, values: &[f64]) -> Vec<(&'static str, f64)> {
        let [s, c, s2, c2] = [0, 1, 2, 3].map(|i| values[i]);
        vec![
            ("amplitude_deg", s.hypot(c)),
            ("phase_deg", c.atan2(s).to_degrees()),
            ("second_amplitude_deg", s2.hypot(c2)),
            ("second_phase_deg", c2.atan2(s2).to_degrees()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_the_swing() {
        Trial::of(Arc::new(EncoderEccentricity), &[0.15, -0.1, 0.0, 0.08]).found_within(0.03);
    }

    #[test]
    fn sine_and_cosine_say_amplitude_and_phase() {
        let (amplitude, phase) = (0.2_f64, 70.0_f64.to_radians());
        let derived = EncoderEccentricity.derived(&[amplitude * phase.cos(), amplitude * phase.sin(), 0.0, 0.0]);
        assert!((derived[0].1 - 0.2).abs() < 1e-12 && (derived[1].1 - 70.0).abs() < 1e-9, "{derived:?}");
    }
}
