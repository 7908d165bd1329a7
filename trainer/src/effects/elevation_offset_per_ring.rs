//! Rays that point higher or lower than the description says, each ring by its own angle.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// φ + δₖ for every ring k.
#[derive(Clone, Copy, Debug)]
pub(super) struct ElevationOffsetPerRing;

impl Effect for ElevationOffsetPerRing {
    fn about(&self) -> About {
        About {
            name: "elevation_offset_per_ring",
            does: "points every ring higher or lower than the model says, by an angle of its own",
            channel: Channel::Geometry,
            acts_on: ActsOn::ALL,
            covariates: &["ring", "elevation"],
            formula: "φ + δ_k",
            source: "vertical correction of every laser in the HDL-64E's calibration file; Muhammad and Lacroix, Calibration of a rotating multi-beam lidar (2010)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("offset_deg", 0.1, (-3.0, 3.0)).per_ring()]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        image.bend.up(values.per_ring(0).deg2rad());
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
        let truth: Vec<f64> = (0..16).map(|k| 0.15 * (1.3 * f64::from(k)).sin()).collect();
        Trial::of(Arc::new(ElevationOffsetPerRing), &truth).found_within(0.03);
    }
}
