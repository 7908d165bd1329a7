//! A sensor that moves while it turns, in scans that are reported as if it had stood still.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// At time t of the sweep the origin is at v·t and the rays are turned by ω·t to the left, both since the sweep began.
#[derive(Clone, Copy, Debug)]
pub(super) struct RollingShutter;

impl Effect for RollingShutter {
    fn about(&self) -> About {
        About {
            name: "rolling_shutter",
            does: "moves {velocity_x_m_s} {ahead|back} and {velocity_y_m_s} to the {left|right} and turns {yaw_rate_deg_s} to the {left|right} while it sweeps",
            channel: Channel::Geometry,
            acts_on: ActsOn::ALL,
            covariates: &["sweep_phase"],
            formula: "o + v·t, θ + ω·t, t = phase / rotation rate",
            source: "motion distortion: Zhang and Singh, LOAM (2014); Vizzo et al., KISS-ICP (2023), constant velocity over a sweep",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::free("velocity_x_m_s", 1.0, (-70.0, 70.0)),
            Parameter::free("velocity_y_m_s", 0.5, (-20.0, 20.0)),
            Parameter::free("yaw_rate_deg_s", 2.0, (-200.0, 200.0)),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let time_s = image.rays.phase.clone() * image.rays.sweep_s;
        image.bend.left(time_s.clone() * values.one(2).deg2rad());
        image.bend.shift([time_s.clone() * values.one(0), time_s.clone() * values.one(1), time_s.zeros_like()]);
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_velocity_and_turn() {
        Trial::of(Arc::new(RollingShutter), &[8.0, -0.4, 10.0]).found_within(0.5);
    }
}
