//! What rays see that do not look where the description says: a resampling of the range image along local surfaces.
//!
//! A moved ray is given the plane of the nearest ray of the simulation and cut with it, so no surface is invented between two. Where it
//! passes between two rays on different surfaces, an image cannot know where the edge lies: the other surface is kept beside it, with
//! the part of the way there as its probability.

use burn::tensor::{Int, Tensor};

use super::image::{Image, Other};
use super::rays::{Bend, Rays};
use super::surface::{Surface, dot};

/// Slope of a surface that no plane is known of: its range is uncertain by this times the ray's displacement.
const UNKNOWN_SLOPE: f64 = 1.5;

impl Image {
    /// Spends [`Image::bend`]: looks along the moved rays.
    pub fn resample(mut self) -> Self {
        if self.bend.is_none() {
            return self;
        }
        let bend = std::mem::take(&mut self.bend);
        let rays = self.rays.clone();
        let [rings, columns] = rays.size();
        let full = rays.azimuth_rad.clone() * 0.0;
        let or_none = |x: &Option<Tensor<3>>| x.as_ref().map_or_else(|| full.clone(), |x| full.clone() + x.clone());
        let (up, left) = (or_none(&bend.elevation_rad).detach(), or_none(&bend.azimuth_rad).detach());

        // Whole pixels, and what is left of the way.
        let spacing = rays.below_rad.clone() + full.clone();
        let spacing = spacing.mask_where(up.clone().greater_elem(0.0), rays.above_rad.clone() + full.clone());
        let down = up / spacing * -1.0;
        let right = left * (-(columns as f64) / (2.0 * std::f64::consts::PI));
        let (whole_down, whole_right) = (down.clone().round(), right.clone().round());
        let (rest_down, rest_right) = (down - whole_down.clone(), right - whole_right.clone());
        let choose = |down: Tensor<3>, right: Tensor<3>| -> Tensor<1, Int> {
            let ring = (rays.ring.clone() + down).clamp(0.0, rings as f64 - 1.0);
            // Column numbers plus half a pixel and a turn: their remainder is never a rounding away from the wrong end.
            let column =
                (rays.column.clone() + right.clone() + (columns as f64 + 0.5)).remainder_scalar(columns as f64);
            (ring * columns as f64 + column.floor()).round().int().reshape([rings * columns])
        };
        let nearest = choose(whole_down.clone(), whole_right.clone());
        let vertical = rest_down.clone().abs().greater_equal(rest_right.clone().abs()).float();
        let beside = choose(
            whole_down + rest_down.clone().sign() * vertical.clone(),
            whole_right + rest_right.clone().sign() * (vertical.clone() * -1.0 + 1.0),
        );
        let weight = rest_down.clone().abs().max_pair(rest_right.clone().abs());

        let true_directions = rays.directions(&bend);
        let here = look(&self.surface, &nearest, &true_directions, &bend, &rays);
        let there = look(&self.surface, &beside, &true_directions, &bend, &rays);

        // The surface that is not known to be flat: how far from the ray of the simulation is it seen?
        let away = (rest_down * rays.below_rad.clone()).square() + (rest_right * column_width(columns)).square();
        let unknown = here.known.clone() * -1.0 + 1.0;
        let doubt_m = here.range_m.clone() * away.sqrt() * unknown * UNKNOWN_SLOPE;
        let sigma = (self.report.range_sigma_m.clone().square() + doubt_m.square()).sqrt();
        self.report.range_sigma_m = sigma;

        self.report.range_m = here.range_m.clone();
        self.report.reflectance = here.reflectance.clone();
        self.report.keep = take(&self.report.keep, &nearest);
        self.other = Some(Other { range_m: there.range_m, hit: there.hit, weight });
        self.surface = here;
        self
    }
}

/// What the moved rays see of the surfaces of the chosen rays.
fn look(surface: &Surface, pixel: &Tensor<1, Int>, directions: &[Tensor<3>; 3], bend: &Bend, rays: &Rays) -> Surface {
    let of = |x: &Tensor<3>| take(x, pixel);
    let plane = [0, 1, 2].map(|i| of(&surface.plane[i]));
    let known = of(&surface.known);
    let seen_m = of(&surface.range_m);
    let facing = dot(&plane, directions);
    let left = match &bend.origin_m {
        None => facing.clone() * 0.0 + 1.0,
        Some(origin) => dot(&plane, origin) * -1.0 + 1.0,
    };
    let cut_m = left / facing.clone().clamp_min(1e-4);
    // A plane that the ray leaves behind, or meets absurdly far from the pixel that knew it, is not hit.
    let hit = of(&surface.hit)
        * facing.clone().greater_elem(1e-4).float()
        * cut_m.clone().lower_elem(rays.limits_m.1).float();
    let near = (cut_m.clone() - seen_m.clone()).abs().lower(seen_m.clone() * 0.5 + 0.5).float();
    let flat = known.clone() * near;
    let range_m = seen_m.mask_where(flat.greater_elem(0.5), cut_m) * hit.clone();
    let size = dot(&plane, &plane).clamp_min(1e-12).sqrt();
    let cosine = (facing / size).clamp(0.01, 1.0);
    let cos_incidence = of(&surface.cos_incidence).mask_where(known.clone().greater_elem(0.5), cosine);
    Surface {
        range_m,
        hit,
        reflectance: of(&surface.reflectance),
        class: of(&surface.class),
        plane,
        known,
        cos_incidence,
    }
}

/// The values at these pixels, `[batch, ring, column]`.
fn take(x: &Tensor<3>, pixel: &Tensor<1, Int>) -> Tensor<3> {
    let [batch, rings, columns] = x.dims();
    x.clone().reshape([batch, rings * columns]).select(1, pixel.clone()).reshape([batch, rings, columns])
}

fn column_width(columns: usize) -> f64 {
    2.0 * std::f64::consts::PI / columns as f64
}
