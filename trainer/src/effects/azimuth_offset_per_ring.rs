//! Rays that point farther to the left or right than the description says, each ring by its own angle.

use super::{About, ActsOn, Channel, Effect, Evidence, Image, Parameter, Values};

/// θ + δₖ for every ring k. Nothing changes on ground or on a wall around the sensor; vertical edges zig-zag from ring to ring.
#[derive(Clone, Copy, Debug)]
pub(super) struct AzimuthOffsetPerRing;

impl Effect for AzimuthOffsetPerRing {
    fn about(&self) -> About {
        About {
            name: "azimuth_offset_per_ring",
            does: "points every ring farther to the left or right than the model says, by an angle of its own",
            channel: Channel::Geometry,
            acts_on: ActsOn::ALL,
            covariates: &["ring", "azimuth"],
            formula: "θ + δ_k",
            source: "rotational correction of every laser in the HDL-64E's calibration file; Muhammad and Lacroix, Calibration of a rotating multi-beam lidar (2010)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::free("offset_deg", 0.1, (-5.0, 5.0)).per_ring()]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        image.bend.left(values.per_ring(0).deg2rad());
        image
    }

    /// The share of a ring's edges that its rays pass to the left, less that to the right, in columns. Without an offset no edge says on
    /// which side to look for one.
    fn starts(&self, evidence: &Evidence) -> Vec<Vec<f64>> {
        let column_deg = 360.0 / evidence.columns.max(1) as f64;
        vec![(0..evidence.rings).map(|ring| column_deg * passed_to_the_left(evidence, ring)).collect()]
    }
}

/// Relative step of the range that counts as an edge.
const EDGE: f32 = 0.1;

/// Edges without an offset that are added to a ring's own: a ring with few of them starts near 0.
const PRIOR_EDGES: f64 = 3.0;

/// Share of a ring's edges whose right pixel measures what the left one should, less the share of those the other way round.
fn passed_to_the_left(evidence: &Evidence, ring: usize) -> f64 {
    let (mut passed, mut edges) = (0.0, PRIOR_EDGES);
    let pixels = evidence.rings * evidence.columns;
    for row in (ring * evidence.columns..evidence.range_m.len()).step_by(pixels) {
        for column in 0..evidence.columns {
            let (left, right) = (row + column, row + (column + 1) % evidence.columns);
            let [l, r] = [left, right].map(|pixel| evidence.range_m[pixel]);
            let step = (l - r).abs();
            if l <= 0.0 || r <= 0.0 || step < EDGE * l.min(r) {
                continue;
            }
            let measures =
                |pixel: usize, m: f32| f64::from(u8::from((evidence.measured_range_m[pixel] - m).abs() < 0.2 * step));
            passed += measures(right, l) - measures(left, r);
            edges += 1.0;
        }
    }
    passed / edges
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_every_ring_that_sees_edges() {
        let truth: Vec<f64> = (0..16).map(|k| 0.2 * (1.3 * f64::from(k) + 0.4).sin()).collect();
        let trial = Trial::of(Arc::new(AzimuthOffsetPerRing), &truth);
        // The lowest rings see little but ground.
        let largest: Vec<f64> = (0..16).map(|k| if k < 11 { 0.1 } else { f64::INFINITY }).collect();
        trial.each_within(&largest);
    }
}
