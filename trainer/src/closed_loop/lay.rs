//! How the surface at each return lies: the plane through the returns around it.
//!
//! A measured scan's neighbouring returns are closer together than its noise is large, so planes are fitted to many of them.

use lidar::{RangeImage, Sensor};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use scene::pose::SENSOR_HEIGHT_M;

/// Half the width over which returns are taken together, in m: several times a range's noise.
const HALF_WIDTH_M: f64 = 0.3;

/// Widest angle to either side, in radians.
const WIDEST_RAD: f64 = 0.035;

/// Returns of one ring are on one surface where neighbouring ranges differ by less than this share.
const SAME_SURFACE: f64 = 0.05;

/// Second difference of the inverse range over rings, relative to it, above which three returns are not on one plane.
const LARGEST_BEND: f64 = 0.1;

/// The ground is lower than this below the sensor, in m.
const GROUND_BELOW_M: f64 = -0.5;

/// What kind of surface it is, as far as its slope tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// Within 25° of level: road, pavement, lawn, a car's roof.
    Level,
    /// Within 25° of upright: walls, the sides of cars, trunks.
    Upright,
}

/// A return and the plane that it lies in.
#[derive(Clone, Copy, Debug)]
pub struct Lay {
    /// The plane a·x = 1, in 1/m, in the sensor's frame.
    pub plane: [f64; 3],
    /// Range at which the ray meets the plane, in m: the measured one with less noise.
    pub range_m: f64,
    /// Cosine of the angle of incidence.
    pub cos_incidence: f64,
    /// Height above the sensor, in m.
    pub height_m: f64,
    /// What the slope says.
    pub kind: Kind,
}

impl Lay {
    /// The plane as a ray in direction `u` (unit vector) meets it; `None` where it does not, or where the slope says nothing.
    pub fn seen(plane: [f64; 3], u: [f64; 3]) -> Option<Self> {
        let facing: f64 = plane.iter().zip(u).map(|(a, u)| a * u).sum();
        let size = plane.iter().map(|a| a * a).sum::<f64>().sqrt();
        let steep = (plane[2] / size).abs();
        let kind = match steep {
            s if s > 0.906 => Kind::Level,
            s if s < 0.423 => Kind::Upright,
            _ => return None,
        };
        (facing > 1e-4 && facing / size > 0.005).then(|| Self {
            plane,
            range_m: 1.0 / facing,
            cos_incidence: facing / size,
            height_m: u[2] / facing,
            kind,
        })
    }
}

/// The lay of each pixel, `[ring, column]`: `None` where there is no return, or no plane.
pub fn lays(image: &RangeImage, sensor: &Sensor) -> Vec<Option<Lay>> {
    let columns = image.columns();
    let points: Vec<Option<Vector3<f64>>> = (image.range_m().iter().enumerate())
        .map(|(i, r)| (*r > 0.0).then(|| Vector3::from(sensor.point_m(i / columns, i % columns, f64::from(*r)))))
        .collect();
    let seen = Seen { image, points: &points, column_rad: std::f64::consts::TAU / columns as f64 };
    (0..points.len()).into_par_iter().map(|i| seen.lay(i)).collect()
}

/// Height of the ground near the sensor, in m: the median of what is level and near and low; that of a car's sensor where nothing is.
pub fn ground_m(lays: &[Option<Lay>]) -> f64 {
    let level = |l: &&Lay| l.kind == Kind::Level && l.range_m < 25.0 && l.height_m < GROUND_BELOW_M;
    let mut heights: Vec<f64> = lays.iter().flatten().filter(level).map(|l| l.height_m).collect();
    if heights.is_empty() {
        return -f64::from(SENSOR_HEIGHT_M);
    }
    let middle = heights.len() / 2;
    *heights.select_nth_unstable_by(middle, f64::total_cmp).1
}

struct Seen<'a> {
    image: &'a RangeImage,
    points: &'a [Option<Vector3<f64>>],
    column_rad: f64,
}

impl Seen<'_> {
    fn lay(&self, i: usize) -> Option<Lay> {
        let point = self.points[i]?;
        let columns = self.image.columns();
        let (ring, column) = ((i / columns) as i64, i % columns);
        let range_m = f64::from(self.image.range_m()[i]);
        let half = (HALF_WIDTH_M / range_m).clamp(self.column_rad, WIDEST_RAD.max(self.column_rad));
        let half = (half / self.column_rad).round() as usize;
        let mut sums = (Matrix3::zeros(), Vector3::zeros(), 0.0);
        let mut rows = 0;
        for row in [-1, 0, 1] {
            if row == 0 || self.on_plane(ring, column, row) {
                rows += usize::from(row != 0);
                self.add_row(ring + row, column, half, &mut sums);
            }
        }
        let (products, sum, count) = sums;
        if rows == 0 || count < 5.0 {
            return None;
        }
        let plane = products.cholesky()?.solve(&sum);
        // Mean square of a·x − 1, the misfit relative to the range.
        let misfit = (count - sum.dot(&plane)).max(0.0) / count;
        let allowed = 0.05 / range_m + 0.005;
        if misfit > allowed * allowed {
            return None;
        }
        let lay = Lay::seen(plane.into(), (point / point.norm()).into())?;
        ((lay.range_m - range_m).abs() < 0.1 + 0.01 * range_m).then_some(lay)
    }

    fn range_m(&self, ring: i64, column: usize) -> Option<f64> {
        let inside = (0..self.image.rings() as i64).contains(&ring);
        let r = if inside { self.image.range_m()[ring as usize * self.image.columns() + column] } else { 0.0 };
        (r > 0.0).then_some(f64::from(r))
    }

    /// Whether the return one ring further (`row` is 1 down, −1 up) seems to be on this one's plane, by the ring beyond it or by the one
    /// on the other side.
    fn on_plane(&self, ring: i64, column: usize, row: i64) -> bool {
        let inverse = |n: i64| self.range_m(ring + n * row, column).map(f64::recip);
        let (Some(here), Some(next)) = (inverse(0), inverse(1)) else { return false };
        let bend = |a: f64, b: f64, c: f64| (a - 2.0 * b + c).abs() / b;
        inverse(2).is_some_and(|beyond| bend(here, next, beyond) < LARGEST_BEND)
            || inverse(-1).is_some_and(|before| bend(before, here, next) < LARGEST_BEND)
    }

    /// Adds the returns of a ring around a column, outwards until one is of another surface.
    fn add_row(&self, ring: i64, column: usize, half: usize, sums: &mut (Matrix3<f64>, Vector3<f64>, f64)) {
        let columns = self.image.columns();
        let mut add = |column: usize| {
            let Some(p) = self.points[ring as usize * columns + column] else { return };
            sums.0 += p * p.transpose();
            sums.1 += p;
            sums.2 += 1.0;
        };
        add(column);
        for side in [1, columns - 1] {
            let mut last = self.range_m(ring, column);
            let mut at = column;
            for _ in 0..half {
                at = (at + side) % columns;
                let here = self.range_m(ring, at);
                if let (Some(here), Some(last)) = (here, last) {
                    if (here - last).abs() > SAME_SURFACE * last.min(here) {
                        break;
                    }
                    add(at);
                }
                last = here.or(last);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn a_noisy_ground_and_a_noisy_wall_are_told_apart_and_smoothed() -> Result<(), Box<dyn std::error::Error>> {
        let sensor = Sensor::builtin("hdl64e")?;
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut image = RangeImage::empty(64, 2048);
        let mut truth = vec![0.0; image.range_m().len()];
        for (i, truth) in truth.iter_mut().enumerate() {
            let [x, _, z] = sensor.direction(i / 2048, i % 2048);
            let ground_m = if z < 0.0 { 1.73 / -z } else { f64::INFINITY };
            let wall_m = if x > 0.0 { 12.0 / x } else { f64::INFINITY };
            *truth = ground_m.min(wall_m);
            if *truth < 60.0 {
                let noise_m = 0.02 * (rng.random::<f64>() + rng.random::<f64>() - 1.0) / 0.408;
                image.set(i, (*truth + noise_m) as f32, 0.5, 0);
            }
        }
        let (mut right, mut known, mut squares, mut angle) = (0, 0, 0.0, 0.0);
        for (i, lay) in lays(&image, &sensor).iter().enumerate() {
            let Some(lay) = lay else { continue };
            let [x, _, z] = sensor.direction(i / 2048, i % 2048);
            let wall = x > 0.0 && (truth[i] - 12.0 / x).abs() < 1e-6;
            known += 1;
            right += usize::from((lay.kind == Kind::Upright) == wall);
            squares += (lay.range_m - truth[i]).powi(2);
            angle += (lay.cos_incidence - if wall { x } else { -z }).abs();
        }
        let known = f64::from(known);
        assert!(known > 0.85 * image.returns() as f64, "{known} of {}", image.returns());
        assert!(right as f64 > 0.99 * known, "{right} of {known}");
        assert!((squares / known).sqrt() < 0.012, "{} m", (squares / known).sqrt());
        assert!(angle / known < 0.03, "{}", angle / known);
        Ok(())
    }
}
