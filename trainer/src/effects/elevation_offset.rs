//! Rays that point higher or lower than the description says, all by the same angle.

use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// φ + δ. On ground Δr ≈ r·cot|φ|·δ, on walls next to nothing, the same at all azimuths.
#[derive(Clone, Copy, Debug)]
pub(super) struct ElevationOffset;

impl Effect for ElevationOffset {
    fn about(&self) -> About {
        About {
            name: "elevation_offset",
            does: "points its rays {offset_deg} {higher|lower} than the model says",
            channel: Channel::Geometry,
            acts_on: ActsOn::ALL,
            covariates: &["elevation"],
            formula: "φ + δ",
            source: "KITTI's HDL-64E: Deschaud, IMLS-SLAM (2018), 0.22°; Vizzo et al., KISS-ICP (2023), 0.205°",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("offset_deg", 0.1, (-3.0, 3.0))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        image.bend.up(values.one(0).deg2rad());
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
        for offset_deg in [0.2, -0.35] {
            Trial::of(Arc::new(ElevationOffset), &[offset_deg]).found_within(0.005);
        }
    }
}
