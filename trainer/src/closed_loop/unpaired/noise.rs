//! The sensor's noise floor, as its own scans show it, and simulated scans that are given the same.
//!
//! Without it a simulated scan would be searched for planes under better conditions than a measured one, and lose no rays at all.

use lidar::{RangeImage, Sensor};
use rand::{Rng, RngExt};
use serde::Serialize;

use super::cells::{Makes, expected};
use crate::closed_loop::lay::{Lay, lays};

/// A normal distribution's median deviation is this part of its standard deviation.
const MEDIAN_DEVIATION: f64 = 0.674_5;

/// Noise of constant size and a constant rate of drop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Noise {
    /// Standard deviation of ranges, in m: of returns around the planes through their neighbours.
    pub range_sigma_m: f64,
    /// Standard deviation of reflectances: of returns around their two neighbours on one plane.
    pub reflectance_sigma: f64,
    /// Share of the rays between two returns of one surface that are lost though more power is expected of them than of half of the rays.
    pub drop: f64,
}

impl Noise {
    /// What scans show.
    pub(super) fn of<'a>(images: impl Iterator<Item = &'a RangeImage>, sensor: &Sensor) -> Self {
        let (mut ranges_m, mut reflectances, mut chances) = (Vec::new(), Vec::new(), Vec::new());
        for image in images {
            let lays = lays(image, sensor);
            let off = |(lay, r): (&Option<Lay>, &f32)| lay.map(|lay| (f64::from(*r) - lay.range_m).abs());
            ranges_m.extend(lays.iter().zip(image.range_m()).filter_map(off));
            let triples = (1..lays.len().saturating_sub(1)).filter(|i| (i - 1..=i + 1).all(|j| lays[j].is_some()));
            let bend = |i: usize| {
                let of = |j: usize| f64::from(image.reflectance()[j]);
                (of(i - 1) - 2.0 * of(i) + of(i + 1)).abs() / 6.0_f64.sqrt()
            };
            reflectances.extend(triples.map(bend));
            chances.extend(expected(image, sensor, &lays, &Makes::default()).map(|(_, expected)| expected));
        }
        let powers = chances.iter().map(|e| e.log_power).collect();
        let typical = median(powers);
        let strong = chances.iter().filter(|e| e.log_power >= typical);
        let (all, missing) = strong.fold((0.0, 0.0), |(n, m), e| (n + 1.0, m + f64::from(u8::from(e.missing))));
        Self {
            range_sigma_m: median(ranges_m) / MEDIAN_DEVIATION,
            reflectance_sigma: median(reflectances) / MEDIAN_DEVIATION,
            drop: if all > 0.0 { missing / all } else { 0.0 },
        }
    }

    /// What has to be added to something with less noise to have this.
    #[must_use]
    pub(super) fn beyond(self, less: Self) -> Self {
        let rest = |more: f64, less: f64| (more.powi(2) - less.powi(2)).max(0.0).sqrt();
        Self {
            range_sigma_m: rest(self.range_sigma_m, less.range_sigma_m),
            reflectance_sigma: rest(self.reflectance_sigma, less.reflectance_sigma),
            drop: (1.0 - (1.0 - self.drop) / (1.0 - less.drop)).max(0.0),
        }
    }

    /// A scan with this noise on top.
    pub(super) fn give(self, image: &RangeImage, dice: &mut impl Rng) -> RangeImage {
        let mut noisy = image.clone();
        for i in 0..image.range_m().len() {
            let range_m = f64::from(image.range_m()[i]);
            if range_m <= 0.0 {
                continue;
            }
            let measured_m = range_m + self.range_sigma_m * normal(dice);
            let reflectance = f64::from(image.reflectance()[i]) + self.reflectance_sigma * normal(dice);
            if dice.random::<f64>() < self.drop || measured_m <= 0.0 {
                noisy.remove(i);
            } else {
                noisy.set(i, measured_m as f32, reflectance.clamp(0.0, 1.0) as f32, image.class()[i]);
            }
        }
        noisy
    }
}

/// A standard normal number (Box and Muller 1958).
fn normal(dice: &mut impl Rng) -> f64 {
    let (u, v): (f64, f64) = (dice.random(), dice.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
