//! How many rays come back, ring by ring.

use lidar::RangeImage;

use crate::metric::Metric;

/// Of the rays that came back.
pub const EMPTY_SHARE: Metric = Metric {
    name: "empty rays by ring",
    unit: "",
    definition: "mean over rings of the difference between the shares of rays without a return, taken as positive; sky and lost rays alike",
};

/// Returns of each ring of a scan, as shares of its rays.
pub fn returned(image: &RangeImage) -> Vec<f64> {
    let share = |row: &[f32]| row.iter().filter(|r| **r > 0.0).count() as f64 / row.len() as f64;
    image.range_m().chunks(image.columns()).map(share).collect()
}

/// [`EMPTY_SHARE`] of two sets of scans' shares.
pub fn difference(a: &[&[f64]], b: &[&[f64]]) -> f64 {
    let mean = |set: &[&[f64]], ring: usize| set.iter().map(|scan| scan[ring]).sum::<f64>() / set.len() as f64;
    let rings = a[0].len();
    (0..rings).map(|ring| (mean(a, ring) - mean(b, ring)).abs()).sum::<f64>() / rings as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_that_lose_more_and_rings_that_lose_less_do_not_make_up_for_each_other() {
        let scan = |empty: &[usize]| {
            let mut image = RangeImage::from_channels(4, vec![5.0; 8], vec![0.1; 8], vec![0; 8]);
            for i in empty {
                image.remove(*i);
            }
            returned(&image)
        };
        let (upper, lower) = (scan(&[0, 1]), scan(&[6]));
        assert_eq!(upper, [0.5, 1.0]);
        // Half of the upper ring, a quarter of the lower one.
        assert!((difference(&[&upper], &[&lower]) - 0.375).abs() < 1e-12);
        assert!((difference(&[&upper, &lower], &[&lower]) - 0.1875).abs() < 1e-12);
    }
}
