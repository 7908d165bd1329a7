//! How true scans are to the simulation that they were made from: a street must stay that street.

use lidar::metrics::mean_absolute_error;
use lidar::{RangeImage, Sensor};
use rayon::prelude::*;

use crate::bootstrap::Draws;
use crate::chamfer::{CHAMFER, chamfer};
use crate::density_aware::{DENSITY_AWARE, density_aware};
use crate::metric::{Metric, Score};
use crate::nearest::Cloud;
use crate::points;

/// Of rays that both report.
pub const RANGE_RMSE: Metric = Metric {
    name: "range RMSE",
    unit: "m",
    definition: "root of the mean squared difference of the range, over all rays that both output and simulation report, of all scans",
};

/// Of rays that both report; where the second is what was measured of the same scene.
pub const REFLECTANCE_MAE: Metric = Metric {
    name: "reflectance MAE",
    unit: "",
    definition: "mean absolute difference of the reflectance (0-1), over all rays that both report; mean over scans",
};

/// Sum of squared differences of the range over rays that both report, in m², and the number of those rays.
pub fn squared_error_m2(output: &RangeImage, simulated: &RangeImage) -> (f64, usize) {
    let both = output.range_m().iter().zip(simulated.range_m()).filter(|(a, b)| **a > 0.0 && **b > 0.0);
    both.fold((0.0, 0), |(sum, n), (a, b)| (sum + f64::from(a - b).powi(2), n + 1))
}

/// [`REFLECTANCE_MAE`] of one scan.
pub fn reflectance_mae(output: &RangeImage, measured: &RangeImage) -> f64 {
    let both = (0..output.range_m().len()).filter(|i| output.range_m()[*i] > 0.0 && measured.range_m()[*i] > 0.0);
    mean_absolute_error(both.map(|i| (output.reflectance()[i], measured.reflectance()[i])))
}

/// [`RANGE_RMSE`], [`CHAMFER`] and [`DENSITY_AWARE`] of outputs and their simulations, in the same order.
///
/// # Panics
/// If there is no scan, not a simulation an output, or a scan has not the sensor's size.
pub fn faithfulness(outputs: &[RangeImage], simulated: &[RangeImage], sensor: &Sensor, draws: Draws) -> Vec<Score> {
    assert!(!outputs.is_empty() && outputs.len() == simulated.len(), "a simulation for each output");
    let pairs: Vec<Pair> =
        outputs.par_iter().zip(simulated).map(|(output, from)| Pair::new(output, from, sensor)).collect();
    let score = |metric: Metric, statistic: &(dyn Fn(&[usize]) -> f64 + Sync)| {
        let found = draws.of_one(pairs.len(), statistic);
        let (scans, against) = (outputs.len(), simulated.len());
        Score { metric, value: found.value, ci95: found.ci95, scans, against, floor: None }
    };
    let mean =
        |of: &[usize], value: fn(&Pair) -> f64| of.iter().map(|i| value(&pairs[*i])).sum::<f64>() / of.len() as f64;
    vec![
        score(RANGE_RMSE, &|of| {
            let sum: f64 = of.iter().map(|i| pairs[*i].squared_error_m2.0).sum();
            (sum / of.iter().map(|i| pairs[*i].squared_error_m2.1).sum::<usize>() as f64).sqrt()
        }),
        score(CHAMFER, &|of| mean(of, |pair| pair.chamfer_m)),
        score(DENSITY_AWARE, &|of| mean(of, |pair| pair.density_aware)),
    ]
}

/// An output beside its simulation.
struct Pair {
    squared_error_m2: (f64, usize),
    chamfer_m: f64,
    density_aware: f64,
}

impl Pair {
    fn new(output: &RangeImage, simulated: &RangeImage, sensor: &Sensor) -> Self {
        let mut shared = simulated.clone();
        for (i, range_m) in output.range_m().iter().enumerate() {
            if *range_m == 0.0 {
                shared.remove(i);
            }
        }
        let cloud = |image: &RangeImage| Cloud::new(points::returns(image, sensor));
        let (made, shared, whole) = (cloud(output), cloud(&shared), cloud(simulated));
        let of = |a: &Option<Cloud>, b: &Option<Cloud>, distance: fn(&Cloud, &Cloud) -> f64| match (a, b) {
            (Some(a), Some(b)) => distance(a, b),
            _ => f64::NAN,
        };
        Self {
            squared_error_m2: squared_error_m2(output, simulated),
            chamfer_m: of(&made, &shared, chamfer),
            density_aware: of(&made, &whole, density_aware),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::slice::from_ref;

    use super::*;

    #[test]
    fn lost_rays_cost_density_alone_and_moved_ones_range() -> Result<(), Box<dyn std::error::Error>> {
        let sensor = Sensor::builtin("vlp16")?.with_columns(64)?;
        // Points more than 2 m apart: each one's nearest is its own twin.
        let n = sensor.pixels();
        let simulated = RangeImage::from_channels(64, vec![90.0; n], vec![0.5; n], vec![0; n]);
        let mut lost = simulated.clone();
        (0..n / 4).for_each(|i| lost.remove(4 * i));
        let moved = RangeImage::from_channels(64, vec![90.25; n], vec![0.7; n], vec![0; n]);
        let value = |output: &RangeImage| -> Vec<f64> {
            let scores = faithfulness(from_ref(output), from_ref(&simulated), &sensor, Draws { count: 0, seed: 0 });
            scores.iter().map(|s| s.value).collect()
        };
        let [range_m, chamfer_m, density] = value(&lost)[..] else { unreachable!("three scores") };
        assert!(range_m == 0.0 && chamfer_m < 1e-6, "{range_m} {chamfer_m}");
        // A quarter of the simulation's points have lost their twin, and most share their neighbour's.
        assert!((0.1..0.3).contains(&density), "{density}");
        let [range_m, chamfer_m, density] = value(&moved)[..] else { unreachable!("three scores") };
        assert!((range_m - 0.25).abs() < 1e-6 && (chamfer_m - 0.25).abs() < 1e-5, "{range_m} {chamfer_m}");
        assert!((density - (1.0 - (-0.25f64).exp())).abs() < 1e-4, "{density}");
        assert!((reflectance_mae(&moved, &simulated) - 0.2).abs() < 1e-6);
        Ok(())
    }
}
