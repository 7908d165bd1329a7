//! How far answers are from real scans of other places: what validation and tables go by.

use lidar::RangeImage;
use serde::{Deserialize, Serialize};

/// Parts of a distribution that are compared.
const QUANTILES: usize = 256;

/// Logarithmic bins of ranges between the sensor's limits, in the comparison of ranges.
const RANGE_BINS: usize = 32;

/// A distance between two sets of scans; 0 is none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Distance {
    /// The metric.
    pub metric: String,
    /// Its unit; empty for pure numbers.
    pub unit: String,
    /// How far the two sets are apart.
    pub value: f64,
}

/// The distances that a translation is judged by, the fewer the better, of its answers to real scans. No scan has a twin.
///
/// - lost rays: mean absolute difference, ring by ring, of the shares of rays without a return;
/// - reflectance: first Wasserstein distance of the reflectances of all returns;
/// - range: Jensen-Shannon divergence, in bits, of the ranges' logarithms in 32 bins, ring by ring, averaged over rings.
///
/// # Panics
/// If either is empty, or their images differ in rings.
pub fn distances(answers: &[RangeImage], real: &[RangeImage]) -> Vec<Distance> {
    let rings = real[0].rings();
    assert!(answers.iter().chain(real).all(|image| image.rings() == rings), "images of {rings} rings");
    let mean_over_rings = |of: &dyn Fn(usize) -> f64| (0..rings).map(of).sum::<f64>() / rings as f64;
    let lost = mean_over_rings(&|ring| (share_lost(answers, ring) - share_lost(real, ring)).abs());
    let range = mean_over_rings(&|ring| jensen_shannon(&ranges(answers, ring), &ranges(real, ring)));
    let distance = |metric: &str, unit: &str, value| Distance { metric: metric.into(), unit: unit.into(), value };
    vec![
        distance("lost rays", "", lost),
        distance("reflectance W1", "", wasserstein(&reflectances(answers), &reflectances(real))),
        distance("range JSD", "bit", range),
    ]
}

fn row(image: &RangeImage, ring: usize) -> &[f32] {
    &image.range_m()[ring * image.columns()..(ring + 1) * image.columns()]
}

fn share_lost(images: &[RangeImage], ring: usize) -> f64 {
    let (lost, rays) = images.iter().fold((0, 0), |(lost, rays), image| {
        let row = row(image, ring);
        (lost + row.iter().filter(|r| **r == 0.0).count(), rays + row.len())
    });
    lost as f64 / rays as f64
}

/// Shares of a ring's returns by their range: bins of equal width in its logarithm, from 1 m to 128 m and beyond.
fn ranges(images: &[RangeImage], ring: usize) -> [f64; RANGE_BINS] {
    let mut shares = [0.0; RANGE_BINS];
    let mut returns = 0.0;
    for range_m in images.iter().flat_map(|image| row(image, ring)).filter(|r| **r > 0.0) {
        let bin = (range_m.log2() / 7.0 * RANGE_BINS as f32).clamp(0.0, RANGE_BINS as f32 - 1.0);
        shares[bin as usize] += 1.0;
        returns += 1.0;
    }
    shares.map(|n| n / f64::max(returns, 1.0))
}

/// Half the Kullback-Leibler divergences of two distributions from their mean, in bits: 0 to 1.
fn jensen_shannon(a: &[f64], b: &[f64]) -> f64 {
    let part = |p: f64, q: f64| if p > 0.0 { p * (2.0 * p / (p + q)).log2() } else { 0.0 };
    a.iter().zip(b).map(|(p, q)| part(*p, *q).midpoint(part(*q, *p))).sum()
}

/// Quantiles of the reflectance of all returns.
fn reflectances(images: &[RangeImage]) -> Vec<f32> {
    let of = |image: &RangeImage| -> Vec<f32> {
        image.range_m().iter().zip(image.reflectance()).filter(|(r, _)| **r > 0.0).map(|(_, x)| *x).collect()
    };
    let mut all: Vec<f32> = images.iter().flat_map(of).collect();
    all.sort_by(f32::total_cmp);
    match all.len() {
        0 => vec![0.0; QUANTILES],
        n => (0..QUANTILES).map(|q| all[(2 * q + 1) * n / (2 * QUANTILES)]).collect(),
    }
}

fn wasserstein(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / a.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(range_m: f32, reflectance: f32) -> RangeImage {
        RangeImage::from_channels(64, vec![range_m; 256], vec![reflectance; 256], vec![0; 256])
    }

    fn values(a: &RangeImage, b: &RangeImage) -> Vec<f64> {
        let of = |image: &RangeImage| vec![image.clone()];
        distances(&of(a), &of(b)).into_iter().map(|d| d.value).collect()
    }

    #[test]
    fn a_set_is_no_distance_from_itself() {
        assert_eq!(values(&image(5.0, 0.4), &image(5.0, 0.4)), [0.0, 0.0, 0.0]);
    }

    #[test]
    fn each_distance_sees_its_own_difference_alone() {
        let near = |found: Vec<f64>, expected: [f64; 3]| {
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} {expected:?}");
        };
        near(values(&image(5.0, 0.4), &image(5.0, 0.6)), [0.0, 0.2, 0.0]);
        near(values(&image(5.0, 0.4), &image(50.0, 0.4)), [0.0, 0.0, 1.0]);
        let mut lossy = image(5.0, 0.4);
        (0..64).for_each(|i| lossy.remove(4 * i));
        near(values(&lossy, &image(5.0, 0.4)), [0.25, 0.0, 0.0]);
    }
}
