//! Beams that meet two surfaces at once, and returns that lie between.

use burn::tensor::Tensor;

use super::image::Mixed;
use super::neighbours::at;
use super::rays::{Bend, Rays};
use super::surface::dot;
use super::{About, ActsOn, Channel, Effect, Image, Parameter, Surface, Values};

/// Range jump in m from which on a neighbour is on another surface.
const JUMP_M: f64 = 0.5;

/// With probability p, a return at a depth edge lies anywhere between its surface and the one beside; with another, one on ground that is
/// seen from the side lies anywhere between the places that neighbouring rays see. Of several such neighbours each is as likely.
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
        let neighbours = apart(&image.surface, &image.rays);
        let number = neighbours.iter().map(|n| n.edge.clone() + n.slope.clone()).reduce(|a, b| a + b);
        let number = number.unwrap_or_else(|| unreachable!("four neighbours")).clamp_min(1.0);
        for Neighbour { range_m, edge, slope } in neighbours {
            let own = image.surface.range_m.clone();
            image.mixed.push(Mixed {
                probability: (edge * values.one(0) + slope * values.one(1)) / number.clone(),
                near_m: own.clone().min_pair(range_m.clone()),
                far_m: own.max_pair(range_m),
            });
        }
        image
    }
}

/// What a pixel beside sees, and 1 where that is another surface, or the same one on a slope.
struct Neighbour {
    range_m: Tensor<3>,
    edge: Tensor<3>,
    slope: Tensor<3>,
}

/// The four neighbours, and which of them are apart.
///
/// A neighbour is on another surface if it is far from the pixel's range, and as far from where the pixel's own plane would be: ground that
/// is seen from the side jumps in range from ring to ring, and has no edge.
fn apart(surface: &Surface, rays: &Rays) -> [Neighbour; 4] {
    let own = &surface.range_m;
    let directions = rays.directions(&Bend::default());
    [(-1, 0), (1, 0), (0, -1), (0, 1)].map(|(down, right)| {
        let range_m = at(own, down, right, 0.0);
        let direction = directions.clone().map(|u| at(&u, down, right, 0.0));
        let expected = dot(&surface.plane, &direction).clamp_min(1e-4).recip();
        let both = range_m.clone().greater_elem(0.0).float() * surface.hit.clone();
        let jump = |from: Tensor<3>| (range_m.clone() - from).abs().greater_elem(JUMP_M).float();
        let jumps = both * jump(own.clone());
        let edge = jumps.clone() * jump(expected);
        Neighbour { slope: jumps - edge.clone(), edge, range_m }
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
