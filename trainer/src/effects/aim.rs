//! Where in the image rays look that are not its own.

use std::f64::consts::PI;

use burn::tensor::{Int, Tensor};

use super::rays::Rays;

/// Deviations up to this part of the way to the pixel beside hardly ever reach it: rays are not lines, and without it a likelihood would
/// have a kink at every pixel's middle.
const WIDTH: f64 = 0.02;

/// What rays look at, places between pixels: `[1, ring, column]` for all scans of a batch alike, or `[batch, ring, column]`.
pub(super) struct Aim {
    /// The pixel whose ray is nearest.
    pub(super) nearest: Pixels,
    /// The pixel beside it towards which the ray deviates, up, down, left or right.
    pub(super) beside: Pixels,
    /// Part of the way to the pixel beside, 0 to ½.
    pub(super) part: Tensor<3>,
    /// Angle to the nearest pixel's ray.
    pub(super) away_rad: Tensor<3>,
}

/// Numbers of pixels, row-major.
pub(super) struct Pixels {
    number: Tensor<3, Int>,
    alike: bool,
}

impl Aim {
    /// Where rays of these elevations and azimuths look; `alike` says that all scans of a batch share them.
    pub(super) fn at([elevation, azimuth]: [Tensor<3>; 2], alike: bool, rays: &Rays) -> Self {
        let [rings, columns] = rays.size();
        let elevation = elevation + azimuth.zeros_like();
        let size = elevation.dims();
        let top = rays.elevation_rad.clone().max_dim(1);
        let entry = ((top - elevation.clone().detach()) * (1.0 / rays.entry_rad)).round();
        let entry = entry.clamp(0.0, rays.nearest_ring.dims()[0] as f64 - 1.0).int().flatten::<1>(0, 2);
        let ring = rays.nearest_ring.clone().select(0, entry);
        let number = ring.clone().int();
        let of_ring = |x: Tensor<1>| x.select(0, number.clone()).reshape(size);
        let per_ring = |x: &Tensor<3>| of_ring(x.clone().flatten(0, 2));
        let down_rad = per_ring(&rays.elevation_rad) - elevation;
        let gap = per_ring(&rays.above_rad).mask_where(down_rad.clone().greater_elem(0.0), per_ring(&rays.below_rad));
        let down = (down_rad.clone() / gap).clamp(-0.5, 0.5);

        let from_left = match &rays.offset_rad {
            None => azimuth * -1.0 + PI,
            Some(offset) => of_ring(offset.clone()) - azimuth + PI,
        };
        let column_rad = 2.0 * PI / columns as f64;
        let column = from_left * (1.0 / column_rad) - 0.5;
        let whole = column.clone().detach().round();
        let right = column - whole.clone();

        let ring = ring.reshape(size);
        let pixels = |down: Option<Tensor<3>>, right: Option<Tensor<3>>| {
            let ring = down.map_or_else(|| ring.clone(), |d| (ring.clone() + d).clamp(0.0, rings as f64 - 1.0));
            let column = right.map_or_else(|| whole.clone(), |r| whole.clone() + r);
            // Half a pixel more: the remainder is never a rounding away from the wrong end.
            let column = (column + 0.5).remainder_scalar(columns as f64).floor();
            Pixels { number: (ring * columns as f64 + column).round().int(), alike }
        };
        let vertical = down.clone().abs().greater_equal(right.clone().abs()).float();
        let across = vertical.clone() * -1.0 + 1.0;
        Self {
            nearest: pixels(None, None),
            beside: pixels(Some(down.clone().detach().sign() * vertical), Some(right.clone().detach().sign() * across)),
            part: part(down.abs().max_pair(right.clone().abs())),
            away_rad: (down_rad.square() + (right * column_rad).square()).clamp_min(1e-12).sqrt(),
        }
    }

    /// Where these points are seen from the origin.
    pub(super) fn of([x, y, z]: [Tensor<3>; 3], rays: &Rays) -> Self {
        let level = (x.clone().square() + y.clone().square()).clamp_min(1e-12).sqrt();
        Self::at([z.atan2(level), y.atan2(x)], false, rays)
    }
}

/// The part of the way that a deviation stands for: 0 at 0, ½ at ½, round at the start.
fn part(deviation: Tensor<3>) -> Tensor<3> {
    let whole = 2.0 * ((0.25 + WIDTH * WIDTH).sqrt() - WIDTH);
    ((deviation.square() + WIDTH * WIDTH).sqrt() - WIDTH) * (1.0 / whole)
}

impl Pixels {
    /// The values at these pixels of an image `[batch, ring, column]`.
    pub(super) fn of(&self, x: &Tensor<3>) -> Tensor<3> {
        let [batch, rings, columns] = x.dims();
        let flat = x.clone().reshape([batch, rings * columns]);
        let values = if self.alike {
            flat.select(1, self.number.clone().flatten(0, 2))
        } else {
            flat.gather(1, self.number.clone().reshape([batch, rings * columns]))
        };
        values.reshape([batch, rings, columns])
    }
}
