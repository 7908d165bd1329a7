//! Empty pixels of a real scan: filled as a simulator would see them, and decoys that keep the filling from giving them away.

use lidar::RangeImage;
use rand::{Rng, RngExt};

/// Farthest return, in columns, that a hole is filled from on one side or the other.
pub const REACH_COLUMNS: usize = 12;

/// The same where there is a return on one side only: beyond, it may as well be the sky.
const REACH_ONE_SIDED: usize = 3;

/// Two returns on either side of a hole lie on one surface if their ranges differ by less than this share.
const SAME_SURFACE: f32 = 0.05;

/// What became of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pixel {
    /// The sensor reported it, and it was left alone.
    Kept,
    /// The sensor did not report it; filled.
    Dropped,
    /// The sensor reported it, but it was emptied and filled like the dropped ones.
    Decoy,
    /// Nothing there, nothing near: sky, or the inside of a large hole.
    Empty,
}

/// A scan without holes, as a simulator would give it.
#[derive(Clone, Debug)]
pub struct Filled {
    /// Ranges and classes; the reflectance of a filled pixel is that of the return that it was filled from.
    pub image: RangeImage,
    /// What became of each pixel, `[ring, column]`.
    pub pixel: Vec<Pixel>,
}

/// Fills the holes of a scan, and as many decoys.
///
/// A network that sees filled holes beside true returns learns to tell a filled pixel from a true one, which is no use on simulated
/// scans, where nothing is filled. Decoys are true returns emptied and filled in the same way, in the shapes of the scan's own holes
/// (turned by a random angle) and singly. Between dropped rays and decoys the filling tells nothing.
pub fn fill(real: &RangeImage, rng: &mut impl Rng) -> Filled {
    let (rings, columns) = (real.rings(), real.columns());
    let returned = |i: usize| real.range_m()[i] > 0.0;
    let turn = rng.random_range(0..columns);
    let mut image = real.clone();
    let mut pixel = vec![Pixel::Empty; rings * columns];
    for ring in 0..rings {
        for column in 0..columns {
            let i = ring * columns + column;
            if returned(i) {
                let decoy = !returned(ring * columns + (column + turn) % columns) || rng.random_bool(0.02);
                pixel[i] = if decoy { Pixel::Decoy } else { Pixel::Kept };
            }
        }
    }
    for ring in 0..rings {
        let row = ring * columns;
        for column in 0..columns {
            let i = row + column;
            if pixel[i] == Pixel::Kept {
                continue;
            }
            let source = |i: usize| pixel[i] == Pixel::Kept;
            let left = (1..=REACH_COLUMNS.min(column)).find(|d| source(i - d));
            let right = (1..=REACH_COLUMNS.min(columns - 1 - column)).find(|d| source(i + d));
            let found = match (left, right) {
                (Some(l), Some(r)) => Some(between(real, (i - l, l), (i + r, r), rng)),
                (Some(l), None) if l <= REACH_ONE_SIDED => Some((real.range_m()[i - l], i - l)),
                (None, Some(r)) if r <= REACH_ONE_SIDED => Some((real.range_m()[i + r], i + r)),
                _ => None,
            };
            match found {
                Some((range_m, from)) => image.set(i, range_m, real.reflectance()[from], real.class()[from]),
                None => image.remove(i),
            }
        }
    }
    for (i, pixel) in pixel.iter_mut().enumerate() {
        if image.range_m()[i] == 0.0 {
            *pixel = Pixel::Empty;
        } else if !returned(i) {
            *pixel = Pixel::Dropped;
        }
    }
    Filled { image, pixel }
}

/// The range between two returns on either side, and the one whose reflectance and class it takes.
///
/// On one surface: linear in inverse range, as a plane is. Across an edge: that of either side, the nearer one more likely.
fn between(
    real: &RangeImage,
    (left, l): (usize, usize),
    (right, r): (usize, usize),
    rng: &mut impl Rng,
) -> (f32, usize) {
    let (a, b) = (real.range_m()[left], real.range_m()[right]);
    let share = l as f32 / (l + r) as f32;
    let from = if rng.random::<f32>() < share { right } else { left };
    if (a - b).abs() < SAME_SURFACE * a.min(b) {
        (1.0 / ((1.0 - share) / a + share / b), from)
    } else {
        (real.range_m()[from], from)
    }
}

/// How many rays each pixel stands for when the sensor's drops are scored or learned, `[ring, column]`: a dropped ray for itself, a
/// decoy for its share of the ring's reported rays, all others for none. The sum is the number of rays that the sensor could have
/// reported.
pub fn weights(pixel: &[Pixel], columns: usize) -> Vec<f32> {
    let mut out = Vec::with_capacity(pixel.len());
    for row in pixel.chunks(columns) {
        let count = |which: Pixel| row.iter().filter(|p| **p == which).count() as f32;
        let (kept, decoys) = (count(Pixel::Kept), count(Pixel::Decoy));
        let decoy_weight = if decoys > 0.0 { (kept + decoys) / decoys } else { 0.0 };
        out.extend(row.iter().map(|p| match p {
            Pixel::Dropped => 1.0,
            Pixel::Decoy => decoy_weight,
            Pixel::Kept | Pixel::Empty => 0.0,
        }));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// A slanted wall seen by 8 rings, with every `every`-th return missing and a wide hole.
    fn wall(columns: usize, every: usize) -> RangeImage {
        let mut image = RangeImage::empty(8, columns);
        for i in 0..8 * columns {
            let column = i % columns;
            let hole = column.is_multiple_of(every) || (60..100).contains(&column);
            if !hole {
                image.set(i, 1.0 / (0.05 + 0.0001 * column as f32), 0.5, 13);
            }
        }
        image
    }

    #[test]
    fn a_hole_in_a_plane_is_filled_with_the_plane() {
        let filled = fill(&wall(256, 16), &mut ChaCha8Rng::seed_from_u64(1));
        let plane_m = |column: usize| 1.0 / (0.05 + 0.0001 * column as f32);
        let (mut exact, mut holes) = (0, 0);
        for (i, pixel) in filled.pixel.iter().enumerate() {
            let column = i % 256;
            if *pixel == Pixel::Dropped {
                let error_m = (filled.image.range_m()[i] - plane_m(column)).abs();
                // Beside a wide hole there is a return on one side only, up to so many columns away.
                let farthest_m = (plane_m(column) - plane_m(column + REACH_ONE_SIDED)).abs() * 1.1;
                assert!(error_m < farthest_m, "column {column}: {error_m} m");
                holes += 1;
                exact += usize::from(error_m < 1e-4);
            }
        }
        assert!(exact * 2 > holes, "{exact} of {holes} holes lie in the plane");
    }

    #[test]
    fn the_inside_of_a_wide_hole_stays_empty() {
        let filled = fill(&wall(256, 16), &mut ChaCha8Rng::seed_from_u64(2));
        assert!((0..8).all(|ring| filled.pixel[ring * 256 + 80] == Pixel::Empty));
    }

    #[test]
    fn dropped_rays_and_decoys_are_what_the_sensor_says() {
        let real = wall(256, 16);
        let filled = fill(&real, &mut ChaCha8Rng::seed_from_u64(3));
        for (i, pixel) in filled.pixel.iter().enumerate() {
            match pixel {
                Pixel::Kept | Pixel::Decoy => assert!(real.range_m()[i] > 0.0),
                Pixel::Dropped => assert_eq!(real.range_m()[i], 0.0),
                Pixel::Empty => assert_eq!(filled.image.range_m()[i], 0.0),
            }
        }
        let count = |which| filled.pixel.iter().filter(|p| **p == which).count();
        assert!(count(Pixel::Dropped) > 50 && count(Pixel::Decoy) > 50);
    }

    #[test]
    fn weights_add_up_to_the_rays_that_could_have_been_reported() {
        let filled = fill(&wall(256, 16), &mut ChaCha8Rng::seed_from_u64(4));
        let rays = filled.pixel.iter().filter(|p| **p != Pixel::Empty).count() as f32;
        let total: f32 = weights(&filled.pixel, 256).iter().sum();
        assert!((total - rays).abs() < 0.5, "{total} of {rays}");
    }
}
