//! Light lost on the way through fog or rain.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// I·e^{−2αr}, and keep·e^{−2αrκ} with the same α.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fog;

impl Effect for Fog {
    fn about(&self) -> About {
        About {
            name: "fog",
            does: "loses light on the way, {alpha_per_m} of it a metre each way, so that far surfaces look darker and return less often",
            channel: Channel::Reflectance,
            acts_on: ActsOn { range: false, reflectance: true, returns: true },
            covariates: &["range"],
            formula: "I·e^{−2αr}, keep·e^{−2αrκ}",
            source: "Beer–Lambert law as in Bijelic et al., A Benchmark for Lidar Sensors in Fog (2018); Hahner et al., Fog Simulation on Real LiDAR Point Clouds (2021), α = 0.005 to 0.06 per m",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("alpha_per_m", 0.003, (0.0, 0.2)), Parameter::positive("drop_coupling", 1.0, (0.03, 10.0))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let depth = image.surface.range_m.clone() * values.one(0) * -2.0;
        image.report.reflectance = image.report.reflectance * depth.clone().exp();
        image.report.keep = image.report.keep * (depth * values.one(1)).exp();
        image
    }

    /// Fog that takes more light than returns is a thinner fog, κ·α, whose κ is 1, and a fall-off with range of (1 − κ)·α.
    fn ties(&self, values: &[f64], stderr: &[f64]) -> &'static [&'static str] {
        if values[1] + 2.0 * stderr[1] < 1.0 { &["reflectance_falloff"] } else { &[] }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_the_same_loss_in_reflectance_and_returns() {
        Trial::of(Arc::new(Fog), &[0.012, 1.0]).each_within(&[0.0005, 0.1]);
        Trial::of(Arc::new(Fog), &[0.005, 0.3]).each_within(&[0.0005, 0.2]);
    }

    #[test]
    fn fog_that_takes_more_light_than_returns_may_be_two_things() {
        assert!(Fog.ties(&[0.01, 0.9], &[0.001, 0.1]).is_empty());
        assert_eq!(Fog.ties(&[0.01, 0.5], &[0.001, 0.1]), ["reflectance_falloff"]);
    }
}
