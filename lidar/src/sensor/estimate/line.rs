//! The line that a ring's points lie on: height against distance from the spin axis.

use super::beams::Beam;

/// z = along · `tangent` + `height_m`, along = √(d² − lateral²).
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    /// Tangent of the elevation.
    pub(super) tangent: f64,
    /// Height at the spin axis.
    pub(super) height_m: f64,
    /// Root mean square residual of the points that are no outliers.
    pub(super) residual_m: f64,
    /// Points farther off than four times the residual's usual size.
    pub(super) outliers: usize,
}

/// Weight of the guess that a ring's height is the usual one, against a point's: a point's millimetre's rounding against 0.1 m.
///
/// Only where all points of a ring are at one distance, so that they leave open how slope and height share, does it matter.
const WEIGHT_OF_USUAL_HEIGHT: f64 = 1e-5;

/// Least squares, repeated without the points farther off than four times the median residual.
pub(super) fn fit(beam: &Beam, lateral_m: f64, usual_height_m: f64) -> Line {
    let along = |i: usize| (beam.away_m[i].powi(2) - lateral_m.powi(2)).max(0.0).sqrt();
    // The median slope is right but for the height, whatever a minority of the points does.
    let mut slopes: Vec<f64> = (0..beam.len()).map(|i| beam.z_m[i] / along(i).max(1e-3)).collect();
    let mut line = Line { tangent: median(&mut slopes), height_m: 0.0, residual_m: f64::INFINITY, outliers: 0 };
    let mut limit_m = f64::INFINITY;
    let mut residuals = Vec::with_capacity(beam.len());
    for _ in 0..12 {
        let mut n = WEIGHT_OF_USUAL_HEIGHT;
        let (mut sd, mut sz, mut sdd, mut sdz) = (0.0, n * usual_height_m, 0.0, 0.0);
        for i in 0..beam.len() {
            let (d, z) = (along(i), beam.z_m[i]);
            if (z - line.tangent * d - line.height_m).abs() <= limit_m {
                n += 1.0;
                sd += d;
                sz += z;
                sdd += d * d;
                sdz += d * z;
            }
        }
        let determinant = n * sdd - sd * sd;
        if determinant.abs() > 1e-12 {
            line.tangent = (n * sdz - sd * sz) / determinant;
            line.height_m = (sz - line.tangent * sd) / n;
        }
        residuals.clear();
        residuals.extend((0..beam.len()).map(|i| (beam.z_m[i] - line.tangent * along(i) - line.height_m).abs()));
        let next_m = 4.0 * median(&mut residuals).max(1e-4);
        let within: Vec<f64> = residuals.iter().copied().filter(|r| *r <= next_m).collect();
        line.residual_m = (within.iter().map(|r| r * r).sum::<f64>() / within.len().max(1) as f64).sqrt();
        line.outliers = residuals.len() - within.len();
        if (limit_m - next_m).abs() < 1e-3 * next_m {
            break;
        }
        limit_m = next_m;
    }
    line
}

/// Median of values in any order; they are sorted partly.
pub(super) fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
