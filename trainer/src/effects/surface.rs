//! The surface that each ray hits, as a plane found from neighbouring rays.
//!
//! On a plane a·x = 1 a ray o + r·u has r = (1 − a·o)/(a·u): inverse range is linear in the ray's direction. The plane through a pixel
//! and one vertical and one horizontal neighbour is exact on flat surfaces; which neighbours lie on the pixel's own surface is decided as
//! essentially-non-oscillatory schemes do (Harten et al. 1987): on either side by the second difference of the inverse range, which is
//! small along one surface and large across an edge or a crease.

use burn::tensor::Tensor;

use super::neighbours::at;
use super::rays::{Bend, Rays};

/// Bend of the inverse range (second difference, relative to it) above which three pixels are not on one surface.
const LARGEST_BEND: f64 = 0.06;

/// What each ray hits; tensors are `[batch, ring, column]`.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Range in m, 0 where nothing is hit.
    pub range_m: Tensor<3>,
    /// 1 where something is hit, else 0.
    pub hit: Tensor<3>,
    /// Reflectance, 0–1.
    pub reflectance: Tensor<3>,
    /// Class index, 0 = unlabelled.
    pub class: Tensor<3>,
    /// The plane a·x = 1 through the hit, in 1/m: ahead, left, up. Where none is known, the one that faces the ray.
    pub plane: [Tensor<3>; 3],
    /// 1 where the plane is known from the neighbours, else 0.
    pub known: Tensor<3>,
    /// Cosine of the angle between the ray and the plane's normal, 0.01 to 1.
    pub cos_incidence: Tensor<3>,
}

/// A neighbour on one side: the vector to it, and how little it seems to be on the same surface.
struct Side {
    to: [Tensor<3>; 3],
    bend: Tensor<3>,
}

impl Surface {
    /// Finds the surfaces of a scan.
    pub fn find(range_m: Tensor<3>, reflectance: Tensor<3>, class: Tensor<3>, rays: &Rays) -> Self {
        let hit = range_m.clone().greater_elem(0.0).float();
        let directions = rays.directions(&Bend::default());
        let point = directions.clone().map(|u| u * range_m.clone());
        let inverse = hit.clone() / range_m.clone().clamp_min(1e-3);
        let seen = Seen { point: &point, inverse: &inverse, class: &class };
        // Steps to the neighbour and from there to the one beyond, as a ratio: rings are not evenly spaced.
        let up = rays.above_rad.clone() / at(&rays.above_rad, -1, 0, 1.0);
        let down = rays.below_rad.clone() / at(&rays.below_rad, 1, 0, 1.0);
        let even = up.clone() * 0.0 + 1.0;
        let vertical = seen.side(-1, 0, &up).or(seen.side(1, 0, &down));
        let horizontal = seen.side(0, -1, &even).or(seen.side(0, 1, &even));

        let normal = cross(&vertical.to, &horizontal.to);
        let offset = dot(&normal, &point);
        let size = dot(&normal, &normal).clamp_min(1e-30).sqrt();
        let cosine = offset.clone().abs() / (size.clone() * range_m.clone().clamp_min(1e-3));
        let flat = vertical.bend.lower_elem(LARGEST_BEND).float() * horizontal.bend.lower_elem(LARGEST_BEND).float();
        let seen = cosine.clone().greater_elem(0.004).float() * size.greater_elem(1e-12).float();
        let known = flat * seen * hit.clone();

        let unknown = known.clone().equal_elem(0.0);
        let offset = offset.mask_fill(unknown.clone(), 1.0);
        let mut plane = normal.map(|n| n / offset.clone());
        for (a, u) in plane.iter_mut().zip(directions) {
            let facing = u * inverse.clone();
            *a = a.clone().mask_where(unknown.clone(), facing);
        }
        let cos_incidence = cosine.mask_fill(unknown, 1.0).clamp(0.01, 1.0);
        Self { range_m, hit, reflectance, class, plane, known, cos_incidence }
    }

    /// Height of the hit above the sensor, in m.
    pub fn height_m(&self, rays: &Rays) -> Tensor<3> {
        self.range_m.clone() * rays.elevation_rad.clone().sin()
    }
}

/// What a pixel's neighbours are judged by.
struct Seen<'a> {
    point: &'a [Tensor<3>; 3],
    inverse: &'a Tensor<3>,
    class: &'a Tensor<3>,
}

impl Seen<'_> {
    /// The neighbour at (down, right), judged by the pixel beyond it; `ratio` is the step to it over the step from it to that pixel.
    fn side(&self, down: i64, right: i64, ratio: &Tensor<3>) -> Side {
        let next = at(self.inverse, down, right, 0.0);
        let beyond = at(self.inverse, 2 * down, 2 * right, 0.0);
        let second = (beyond.clone() - next.clone()) * ratio.clone() - (next.clone() - self.inverse.clone());
        let no_beyond = beyond.lower_elem(1e-9);
        let bend = second.abs().mask_fill(no_beyond.clone(), 0.0) / self.inverse.clone().clamp_min(1e-6);
        let no_next = next.lower_elem(1e-9).float();
        let elsewhere = |n: i64| {
            let class = at(self.class, n * down, n * right, -1.0) - self.class.clone();
            class.abs().greater_elem(0.5).float()
        };
        // A pixel that lacks the one beyond can still be judged worse than any that has it, and better than none.
        let doubt = (no_beyond.float() + elsewhere(2)) * (0.5 * LARGEST_BEND) + (no_next + elsewhere(1)) * 1e3;
        let to = self.point.clone().map(|x| at(&x, down, right, 0.0) - x);
        Side { to, bend: bend.clamp_max(1e2) + doubt }
    }
}

impl Side {
    /// The better of two sides, pixel by pixel.
    fn or(self, other: Self) -> Self {
        let worse = other.bend.clone().lower(self.bend.clone());
        let [x, y, z] = self.to;
        let [ox, oy, oz] = other.to;
        Self {
            to: [x.mask_where(worse.clone(), ox), y.mask_where(worse.clone(), oy), z.mask_where(worse.clone(), oz)],
            bend: self.bend.mask_where(worse, other.bend),
        }
    }
}

/// Scalar product.
pub(crate) fn dot(a: &[Tensor<3>; 3], b: &[Tensor<3>; 3]) -> Tensor<3> {
    let [x, y, z] = [0, 1, 2].map(|i| a[i].clone() * b[i].clone());
    x + y + z
}

fn cross(a: &[Tensor<3>; 3], b: &[Tensor<3>; 3]) -> [Tensor<3>; 3] {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| a[i].clone() * b[j].clone() - a[j].clone() * b[i].clone())
}
