//! Footprints that stretch on slanted surfaces, and ranges that stretch with them.

use super::incidence::log_cosine;
use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values};

/// Range at which the bias of a metre per tangent is quoted, whatever it does with range.
const AT_M: f64 = 10.0;

/// r + b·(r/10 m)ᵏ·t and σ² + (s·(r/10 m)ᵏ·t)², t being tan α up to a largest tangent: k = 0 depends on the angle alone, k = 1 is a footprint
/// that grows with range.
#[derive(Clone, Copy, Debug)]
pub(super) struct IncidenceStretch;

/// Mean and standard deviation of tan α, up to 10, where nothing shows the angle: see [`log_cosine`] for how such angles are distributed.
const UNKNOWN_TAN: (f64, f64) = (1.5, 1.5);

impl Effect for IncidenceStretch {
    fn about(&self) -> About {
        About {
            name: "incidence_stretch",
            does: "measures slanted surfaces {bias_per_tan_m} too {far|near} for each tangent of the incidence angle, at 10 m",
            channel: Channel::Range,
            acts_on: ActsOn::RANGE,
            covariates: &["incidence"],
            formula: "r + b·(r/10 m)ᵏ·t, σ² + (s·(r/10 m)ᵏ·t)², t = min(tan α, T)",
            source: "Soudarissanane et al., Scanning Geometry: Influencing Factor on the Quality of Terrestrial Laser Scanning Points (ISPRS Journal, 2011)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::free("bias_per_tan_m", 0.01, (-0.5, 0.5)),
            Parameter::positive("spread_per_tan_m", 0.003, (1e-5, 0.5)),
            Parameter::free("range_power", 0.3, (-1.0, 2.0)),
            Parameter::positive("largest_tan", 10.0, (1.5, 100.0)),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let (log_cosine, variance) = log_cosine(&image.surface, &image.rays);
        let unknown = variance.greater_elem(0.0);
        let cosine = log_cosine.exp();
        let tan = (cosine.clone().square() * -1.0 + 1.0).clamp_min(1e-6).sqrt() / cosine;
        // A minimum without a corner.
        let over = (tan.clone() / values.one(3)).clamp(1e-3, 1e3);
        let tan = tan / ((over.log() * 8.0).clamp_max(40.0).exp() + 1.0).log().div_scalar(8.0).exp();
        let tan = tan.mask_fill(unknown.clone(), UNKNOWN_TAN.0);
        let far = (image.surface.range_m.clone().clamp_min(1e-2) / AT_M).log() * values.one(2).clamp(-4.0, 4.0);
        let far = far.exp();
        let stretch = tan * far.clone();
        image.report.range_m = image.report.range_m + stretch.clone() * values.one(0);
        let spread = stretch * values.one(1);
        let doubt = far * unknown.float() * values.one(0) * UNKNOWN_TAN.1;
        image.report.range_sigma_m = (image.report.range_sigma_m.square() + spread.square() + doubt.square()).sqrt();
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_bias_spread_and_how_they_grow() {
        for truth in [[0.02, 0.01, 0.0, 10.0], [0.01, 0.02, 1.0, 6.0], [-0.03, 0.003, 0.5, 8.0]] {
            Trial::of(Arc::new(IncidenceStretch), &truth).each_within(&[0.002, 0.004, 0.1, 0.8]);
        }
    }
}
