//! Which reflectances scans report.

use lidar::RangeImage;

use crate::metric::Metric;

/// Of the reported reflectances.
pub const REFLECTANCE_W1: Metric = Metric {
    name: "Wasserstein-1 of reflectance",
    unit: "",
    definition: "area between the distribution functions of the reflectance (0-1) of all returns of all scans, in steps of a thousandth",
};

/// Steps of reflectance.
const STEPS: usize = 1000;

/// Counts of a scan's reflectances, by thousandths.
pub fn count(image: &RangeImage) -> Vec<u32> {
    let mut counts = vec![0; STEPS + 1];
    for (range_m, reflectance) in image.range_m().iter().zip(image.reflectance()) {
        if *range_m > 0.0 {
            counts[(reflectance.clamp(0.0, 1.0) * STEPS as f32).round() as usize] += 1;
        }
    }
    counts
}

/// [`REFLECTANCE_W1`] of two sets of scans' counts. NaN if either holds no return.
pub fn wasserstein_1<'a>(a: impl IntoIterator<Item = &'a [u32]>, b: impl IntoIterator<Item = &'a [u32]>) -> f64 {
    let (a, b) = (shares(a), shares(b));
    let (mut below, mut sum) = (0.0, 0.0);
    for (a, b) in a.iter().zip(&b) {
        below += a - b;
        sum += f64::abs(below);
    }
    sum / STEPS as f64
}

fn shares<'a>(counts: impl IntoIterator<Item = &'a [u32]>) -> Vec<f64> {
    let mut sum = vec![0.0; STEPS + 1];
    for one in counts {
        sum.iter_mut().zip(one).for_each(|(sum, count)| *sum += f64::from(*count));
    }
    let total: f64 = sum.iter().sum();
    sum.into_iter().map(|count| count / total).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    // `scipy.stats.wasserstein_distance([.1, .2, .3, .9], [.05, .2, .2, .4, .6, 1])`
    #[test]
    fn the_distance_is_scipys() {
        let scan = |reflectance: &[f32]| {
            let n = reflectance.len();
            count(&RangeImage::from_channels(n, vec![5.0; n], reflectance.to_vec(), vec![0; n]))
        };
        let (a, b) = (scan(&[0.1, 0.2, 0.3, 0.9]), scan(&[0.05, 0.2, 0.2, 0.4, 0.6, 1.0]));
        let found = wasserstein_1([a.as_slice()], [b.as_slice()]);
        assert!((found - 0.1).abs() < 1e-9, "{found}");
        // What has no return has no reflectance.
        assert_eq!(count(&RangeImage::empty(2, 8)).iter().sum::<u32>(), 0);
    }
}
