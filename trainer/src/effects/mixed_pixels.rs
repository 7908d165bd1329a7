//! Beams that meet two surfaces at once, and returns that lie between.

use burn::tensor::Tensor;

use super::image::Mixed;
use super::neighbours::at;
use super::rays::{Bend, Rays};
use super::surface::dot;
use super::{About, ActsOn, Channel, Effect, Image, Parameter, Surface, Values};

/// Range jump in m from which on a neighbour is on another surface.
const JUMP_M: f64 = 0.5;

/// With probability p, a return at a depth edge lies anywhere between the two surfaces; with another, one on ground that is seen from the
/// side lies anywhere between the places that neighbouring rays see.
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
        vec![
            Parameter::probability("probability", 0.03, (1e-4, 0.95)),
            Parameter::probability("slope_probability", 0.003, (0.0, 0.95)),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let [edges, slopes] = between(&image.surface, &image.rays);
        image.mixed.push(edges.mixed(|edge| edge * values.one(0)));
        image.mixed.push(slopes.mixed(|slope| slope * values.one(1)));
        image
    }
}

/// The nearest and the farthest of what a pixel and its neighbours see.
struct Between {
    near_m: Tensor<3>,
    far_m: Tensor<3>,
}

impl Between {
    /// The same with a neighbour of these ranges; where it is the pixel's own, nothing changes.
    fn and(self, theirs_m: Tensor<3>) -> Self {
        Self { near_m: self.near_m.min_pair(theirs_m.clone()), far_m: self.far_m.max_pair(theirs_m) }
    }

    /// Returns between the two, with a probability that is made of 1 where they are apart and 0 elsewhere.
    fn mixed(self, probability: impl FnOnce(Tensor<3>) -> Tensor<3>) -> Mixed {
        let apart = (self.far_m.clone() - self.near_m.clone()).greater_elem(JUMP_M).float();
        Mixed { probability: probability(apart), near_m: self.near_m, far_m: self.far_m }
    }
}

/// Between which ranges a return may lie: at edges, and on slopes.
///
/// A neighbour is on another surface if it is far from the pixel's range, and as far from where the pixel's own plane would be: ground that
/// is seen from the side jumps in range from ring to ring, and has no edge.
fn between(surface: &Surface, rays: &Rays) -> [Between; 2] {
    let own = &surface.range_m;
    let directions = rays.directions(&Bend::default());
    let alone = || Between { near_m: own.clone(), far_m: own.clone() };
    [(-1, 0), (1, 0), (0, -1), (0, 1)].into_iter().fold([alone(), alone()], |[edges, slopes], (down, right)| {
        let theirs = at(own, down, right, 0.0);
        let direction = directions.clone().map(|u| at(&u, down, right, 0.0));
        let expected = dot(&surface.plane, &direction).clamp_min(1e-4).recip();
        let both = theirs.clone().greater_elem(0.0).float() * surface.hit.clone();
        let jump = |from: Tensor<3>| (theirs.clone() - from).abs().greater_elem(JUMP_M).float();
        let jumps = both * jump(own.clone());
        let apart = jumps.clone() * jump(expected);
        let only = |mask: Tensor<3>| own.clone().mask_where(mask.greater_elem(0.5), theirs.clone());
        [edges.and(only(apart.clone())), slopes.and(only(jumps - apart))]
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
            Trial::of(Arc::new(MixedPixels), &[probability, 0.1]).found_within(0.05);
        }
    }
}
