//! What a model leaves unexplained of each ray, channel by channel.
//!
//! Standardised, so that rays of different noise can be compared, and held to ±4, so that a few outliers do not decide; and in physical
//! units for people. Geometry has no residual of its own: moved rays show as range and as missing returns.

use super::Map;
use crate::closed_loop::predicted::Predicted;
use crate::effects::Channel;

/// Channels that have a residual.
pub const CHANNELS: [Channel; 5] =
    [Channel::Range, Channel::RangeVariance, Channel::Reflectance, Channel::Missing, Channel::Extra];

/// Standardised residuals are held to this.
const LARGEST: f64 = 4.0;

/// Range residuals count up to this in pictures, in m: a stray return is no bias.
pub(super) const LARGEST_M: f64 = 1.0;

/// Squares are held above this, for the logarithm of a residual that happens to be 0 says nothing.
const LEAST_SQUARE: f64 = 1e-3;

/// Expectation of ln max(χ², [`LEAST_SQUARE`]) with one degree of freedom: −γ − ln 2 without the floor, which adds 4·φ(0)·√floor.
const MEAN_LOG_CHI2: f64 = -1.219_903;

/// Its standard deviation, by quadrature.
const SIGMA_LOG_CHI2: f64 = 2.039_972;

/// Variance of a yes or no below which it does not count: a certain prediction that fails is one event, not a thousand.
const LEAST_VARIANCE: f64 = 1e-3;

/// Residuals of every ray, a list a channel of [`CHANNELS`]; NaN where a ray says nothing.
#[derive(Clone, Debug, Default)]
pub(super) struct Residuals {
    pub(super) standardised: [Vec<f32>; 5],
    pub(super) physical: [Vec<f32>; 5],
}

/// Unit of a channel's residual for people.
pub fn unit(channel: Channel) -> &'static str {
    match channel {
        Channel::Range | Channel::Geometry => "m",
        Channel::RangeVariance => "ln (variance / model's)",
        Channel::Reflectance => "reflectance",
        Channel::Missing => "share of rays with a return",
        Channel::Extra => "share of extra returns",
    }
}

impl Residuals {
    pub(super) fn add(&mut self, rays: &Predicted) {
        for i in 0..rays.hit.len() {
            let of = [range(rays, i), range_variance(rays, i), reflectance(rays, i), missing(rays, i), extra(rays, i)];
            for (c, residual) in of.into_iter().enumerate() {
                let (standardised, physical) = residual.unwrap_or((f64::NAN, f64::NAN));
                self.standardised[c].push(standardised as f32);
                self.physical[c].push(physical as f32);
            }
        }
    }

    pub(super) fn maps(&self, [rings, columns]: [usize; 2]) -> Vec<Map> {
        let map = |(channel, residual): (&Channel, &Vec<f32>)| {
            let mut mean = vec![0.0; rings * columns];
            let mut n = vec![0.0; rings * columns];
            for frame in residual.chunks(rings * columns) {
                for (i, y) in frame.iter().enumerate().filter(|(_, y)| !y.is_nan()) {
                    mean[i] += y;
                    n[i] += 1.0;
                }
            }
            // 0/0 is the NaN that says that nothing was measured.
            mean.iter_mut().zip(n).for_each(|(mean, n)| *mean /= n);
            Map { channel: *channel, columns, mean }
        };
        CHANNELS.iter().zip(&self.physical).map(map).collect()
    }
}

/// Whether the range of a return says something about its surface.
fn says(rays: &Predicted, i: usize) -> bool {
    rays.is_return_of_a_surface(i) && rays.certain[i]
}

fn range(rays: &Predicted, i: usize) -> Option<(f64, f64)> {
    says(rays, i).then(|| {
        let off_m = f64::from(rays.measured_range_m[i] - rays.range_m[i]);
        (rays.standardised_range(i).clamp(-LARGEST, LARGEST), off_m.clamp(-LARGEST_M, LARGEST_M))
    })
}

fn range_variance(rays: &Predicted, i: usize) -> Option<(f64, f64)> {
    (says(rays, i) && !rays.is_outlier(i)).then(|| {
        let square = rays.standardised_range(i).powi(2);
        let log = square.max(LEAST_SQUARE).ln() - MEAN_LOG_CHI2;
        (log / SIGMA_LOG_CHI2, log)
    })
}

fn reflectance(rays: &Predicted, i: usize) -> Option<(f64, f64)> {
    (rays.is_return_of_a_surface(i) && rays.certain[i]).then(|| {
        let sigma = f64::from(rays.reflectance_sigma[i].max(1e-6));
        let off = f64::from(rays.measured_reflectance[i] - rays.reflectance[i]);
        ((off / sigma).clamp(-LARGEST, LARGEST), off)
    })
}

fn missing(rays: &Predicted, i: usize) -> Option<(f64, f64)> {
    (rays.hit[i] > 0.5 && rays.certain[i]).then(|| yes_or_no(rays.returned(i), f64::from(rays.reported[i])))
}

/// A return that no surface explains: where nothing is hit, or far off the surface.
fn extra(rays: &Predicted, i: usize) -> Option<(f64, f64)> {
    let hit = rays.hit[i] > 0.5;
    rays.certain[i].then(|| {
        let is = rays.returned(i) && (!hit || rays.is_outlier(i));
        yes_or_no(is, f64::from(rays.extra[i]))
    })
}

/// Pearson's residual, and the plain one.
fn yes_or_no(is: bool, probability: f64) -> (f64, f64) {
    let off = f64::from(u8::from(is)) - probability;
    (off / (probability * (1.0 - probability)).max(LEAST_VARIANCE).sqrt(), off)
}
