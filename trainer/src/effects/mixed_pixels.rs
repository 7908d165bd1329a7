//! Beams that meet two surfaces at once, and returns that lie between.

use burn::tensor::Tensor;

use super::image::Mixed;
use super::neighbours::at;
use super::rays::{Bend, Rays};
use super::surface::dot;
use super::{About, ActsOn, Channel, Effect, Image, Parameter, Surface, Values};

/// Range jump in m from which on a neighbour is on another surface.
const JUMP_M: f64 = 0.5;

/// With probability p, a return at a depth edge lies anywhere between the two surfaces.
#[derive(Clone, Copy, Debug)]
pub(super) struct MixedPixels;

impl Effect for MixedPixels {
    fn about(&self) -> About {
        About {
            name: "mixed_pixels",
            does: "returns something between two surfaces, with probability {probability} at a depth edge",
            channel: Channel::Range,
            acts_on: ActsOn::RANGE,
            covariates: &["depth_jump"],
            formula: "w·r_near + (1 − w)·r_far, w uniform in 0–1",
            source: "Tuley, Vandapel and Hebert, Analysis and Removal of Artifacts in 3-D LADAR Data (ICRA 2005)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::probability("probability", 0.03, (1e-4, 0.95))]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let [near_m, far_m] = between(&image.surface, &image.rays);
        let edge = (far_m.clone() - near_m.clone()).greater_elem(JUMP_M).float();
        image.mixed = Some(Mixed { probability: edge * values.one(0), near_m, far_m });
        image
    }
}

/// The nearest and the farthest of each pixel's own surface and those that begin at its edges; the same away from edges.
///
/// A neighbour is on another surface if it is far from the pixel's range, and as far from where the pixel's own plane would be: ground that
/// is seen from the side jumps in range from ring to ring, and has no edge.
fn between(surface: &Surface, rays: &Rays) -> [Tensor<3>; 2] {
    let own = &surface.range_m;
    let directions = rays.directions(&Bend::default());
    let ends = [own.clone(), own.clone()];
    [(-1, 0), (1, 0), (0, -1), (0, 1)].into_iter().fold(ends, |[near, far], (down, right)| {
        let theirs = at(own, down, right, 0.0);
        let direction = directions.clone().map(|u| at(&u, down, right, 0.0));
        let expected = dot(&surface.plane, &direction).clamp_min(1e-4).recip();
        let both = theirs.clone().greater_elem(0.0).float() * surface.hit.clone();
        let jump = |from: Tensor<3>| (theirs.clone() - from).abs().greater_elem(JUMP_M).float();
        let same = (both * jump(own.clone()) * jump(expected)).lower_elem(0.5);
        let theirs = theirs.mask_where(same, own.clone());
        [near.min_pair(theirs.clone()), far.max_pair(theirs)]
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_the_probability() {
        for probability in [0.1, 0.4] {
            Trial::of(Arc::new(MixedPixels), &[probability]).found_within(0.05);
        }
    }
}
