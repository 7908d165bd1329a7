//! CLS2R's metrics as its authors' code has them, to stand beside its tables; not those to choose a model by.
//!
//! Haghighi et al., "Contrastive learning-based framework for sim-to-real mapping of lidar point clouds in autonomous driving systems"
//! (2023). What differs from the metrics of the same name here: a ray without a return is a point at the sensor's origin, 512 points stand
//! for a scan, lengths are in units of 120 m and squared, patches are standardised set by set and mirrored at the seam. Its FID (4096
//! activations, drawn once, of a `RangeNet++` whose weights it does not publish) cannot be computed again.

use lidar::{RangeImage, Sensor};
use rayon::prelude::*;

use crate::bootstrap::Draws;
use crate::chamfer::squared_chamfer_of_few;
use crate::farthest::farthest_points;
use crate::kernel::Table;
use crate::matching::{POINTS, minimum_matching};
use crate::metric::{Metric, Score};
use crate::points::{Point, every_pixel};
use crate::pyramid::{Border, Plane};
use crate::sliced::{Length, Scale, Slicer, Slices};
use crate::voxels;

/// CLS2R's SWD.
pub const SLICED: Metric = Metric {
    name: "cls2r SWD",
    unit: "",
    definition: "as in CLS2R's code: sliced Wasserstein-1 distance on Laplacian pyramids of the inverse range, −1 (120 m, no return) to 1 (0.9 m), \
                 mirrored at the seam: 3 levels, 128 patches of 7 × 7, 512 directions whose numbers have a standard deviation of 1, patches \
                 standardised by each set's own mean and deviation",
};

/// CLS2R's JSD.
pub const JSD: Metric = Metric {
    name: "cls2r JSD",
    unit: "bits",
    definition: "as in CLS2R's code: Jensen-Shannon divergence, base 2, of the counts in 28³ voxels of 512 points a scan by farthest point sampling, \
                 rays without a return being points at the origin",
};

/// CLS2R's MMD.
pub const MMD: Metric = Metric {
    name: "cls2r MMD",
    unit: "(120 m)²",
    definition: "as in CLS2R's code: minimum matching distance, mean over real scans of the least squared Chamfer distance (both ways added) of 512 \
                 points a scan by farthest point sampling, rays without a return being points at the origin",
};

/// CLS2R's CD.
pub const CHAMFER: Metric = Metric {
    name: "cls2r CD",
    unit: "(120 m)²",
    definition: "as in CLS2R's code: squared Chamfer distance (both ways added) of output and simulation, 512 points each by farthest point sampling, \
                 rays without a return being points at the origin; mean over scans",
};

/// CLS2R's RMSE.
pub const RMSE: Metric = Metric {
    name: "cls2r RMSE",
    unit: "120 m",
    definition: "as in CLS2R's code: root mean squared difference of the range of output and simulation over all rays, rays without a return being at \
                 120 m; mean over scans (the paper gives no unit)",
};

/// The unit of length, in metres, and the least range.
const UNIT_M: f32 = 120.0;
const NEAREST_M: f32 = 0.9;

/// Seed of patches and directions.
const SEED: u64 = 12;

/// Scans, summed up as CLS2R does.
#[derive(Clone, Debug)]
pub struct Set {
    few: Vec<Vec<Point>>,
    voxels: Vec<Vec<u32>>,
    slices: Vec<Slices>,
    slicer: Slicer,
}

impl Set {
    /// Sums up scans of a sensor.
    ///
    /// # Panics
    /// If there is no scan, or one has not the sensor's size, which is at least 28 × 28.
    pub fn new(images: &[RangeImage], sensor: &Sensor) -> Self {
        assert!(!images.is_empty(), "a set has a scan");
        let slicer = Slicer::new(Border::Mirror, Length::Deviation, SEED);
        let few: Vec<Vec<Point>> = images.par_iter().map(|image| few(image, sensor)).collect();
        let voxels = few.iter().map(|points| voxels::count(points, 1.0)).collect();
        let plane = |image: &RangeImage| Plane {
            columns: image.columns(),
            values: image.range_m().iter().map(|r| inverse(*r)).collect(),
        };
        let slices = images.par_iter().enumerate().map(|(k, image)| slicer.slice(plane(image), k)).collect();
        Self { few, voxels, slices, slicer }
    }

    /// SWD, JSD and MMD against real scans.
    pub fn against(&self, real: &Self, draws: Draws) -> Vec<Score> {
        let sizes = [self.few.len(), real.few.len()];
        let score = |metric: Metric, statistic: &(dyn Fn(&[usize], &[usize]) -> f64 + Sync)| {
            let found = draws.of_two(sizes, statistic);
            Score { metric, value: found.value, ci95: found.ci95, scans: sizes[0], against: sizes[1], floor: None }
        };
        let distance = Table::new(sizes[0], sizes[1], |i, j| squared_chamfer_of_few(&self.few[i], &real.few[j]));
        vec![
            score(SLICED, &|a, b| self.slicer.distance(&pick(&self.slices, a), &pick(&real.slices, b), Scale::OfEach)),
            score(JSD, &|a, b| {
                let of = |counts: &'_ [Vec<u32>], which: &[usize]| {
                    which.iter().map(|i| counts[*i].clone()).collect::<Vec<Vec<u32>>>()
                };
                let (a, b) = (of(&self.voxels, a), of(&real.voxels, b));
                voxels::jsd_bits(a.iter().map(Vec::as_slice), b.iter().map(Vec::as_slice))
            }),
            score(MMD, &|a, b| minimum_matching(&distance, a, b)),
        ]
    }
}

/// CD and RMSE of outputs and their simulations, in the same order.
///
/// # Panics
/// If there is no scan, not a simulation an output, or a scan has not the sensor's size.
pub fn faithfulness(outputs: &[RangeImage], simulated: &[RangeImage], sensor: &Sensor, draws: Draws) -> Vec<Score> {
    assert!(!outputs.is_empty() && outputs.len() == simulated.len(), "a simulation for each output");
    let each = |of: fn(&RangeImage, &RangeImage, &Sensor) -> f64| -> Vec<f64> {
        outputs.par_iter().zip(simulated).map(|(a, b)| of(a, b, sensor)).collect()
    };
    let score = |metric: Metric, values: &[f64]| {
        let found = draws.of_one(values.len(), |of| of.iter().map(|i| values[*i]).sum::<f64>() / of.len() as f64);
        let (scans, against) = (outputs.len(), simulated.len());
        Score { metric, value: found.value, ci95: found.ci95, scans, against, floor: None }
    };
    let distance =
        |a: &RangeImage, b: &RangeImage, sensor: &Sensor| squared_chamfer_of_few(&few(a, sensor), &few(b, sensor));
    vec![score(CHAMFER, &each(distance)), score(RMSE, &each(|a, b, _| rmse(a, b)))]
}

/// 512 of a scan's rays, in units of 120 m.
fn few(image: &RangeImage, sensor: &Sensor) -> Vec<Point> {
    let points: Vec<Point> = every_pixel(image, sensor).into_iter().map(|p| p.map(|x| x / UNIT_M)).collect();
    farthest_points(&points, POINTS)
}

/// Inverse range, from −1 where there is no return to 1 at the least range.
fn inverse(range_m: f32) -> f32 {
    if range_m <= 0.0 {
        return -1.0;
    }
    let inverse = 1.0 / range_m.clamp(NEAREST_M, UNIT_M);
    2.0 * (inverse - 1.0 / UNIT_M) / (1.0 / NEAREST_M - 1.0 / UNIT_M) - 1.0
}

fn rmse(a: &RangeImage, b: &RangeImage) -> f64 {
    let length = |r: &f32| if *r > 0.0 { f64::from(*r / UNIT_M) } else { 1.0 };
    let squared = a.range_m().iter().zip(b.range_m()).map(|(a, b)| (length(a) - length(b)).powi(2));
    (squared.sum::<f64>() / a.range_m().len() as f64).sqrt()
}

fn pick<'a, T>(from: &'a [T], which: &[usize]) -> Vec<&'a T> {
    which.iter().map(|i| &from[*i]).collect()
}

#[cfg(test)]
mod tests {
    use std::slice::from_ref;

    use super::*;

    #[test]
    fn inverse_range_goes_from_its_nearest_to_its_farthest() {
        assert!((inverse(0.9) - 1.0).abs() < 1e-6 && (inverse(120.0) + 1.0).abs() < 1e-6);
        assert_eq!(inverse(0.0), -1.0);
        // Half of the code is spent on what is nearer than 2 m.
        assert!(inverse(1.79).abs() < 0.01);
    }

    #[test]
    fn a_lost_ray_is_120_m_away_in_rmse_and_at_the_origin_in_chamfer() -> Result<(), Box<dyn std::error::Error>> {
        let sensor = Sensor::builtin("hdl32e")?.with_columns(32)?;
        let n = sensor.pixels();
        let simulated = RangeImage::from_channels(32, vec![60.0; n], vec![0.5; n], vec![0; n]);
        let mut output = simulated.clone();
        (0..n / 4).for_each(|i| output.remove(4 * i));
        let scores = faithfulness(from_ref(&output), from_ref(&simulated), &sensor, Draws { count: 0, seed: 0 });
        // A quarter of the rays is 60 m off, that is half a unit.
        assert!((scores[1].value - 0.25).abs() < 1e-6, "{}", scores[1].value);
        // Output and simulation have their points on one sphere, but one of the output's is at its middle, half a unit from all others.
        let middle = few(&output, &sensor).iter().filter(|p| **p == [0.0; 3]).count();
        assert!(middle >= 1);
        let own = squared_chamfer_of_few(&few(&simulated, &sensor), &few(&simulated, &sensor));
        assert!(own == 0.0 && scores[0].value > 0.25 / 512.0, "{}", scores[0].value);
        let set = |image: &RangeImage| Set::new(&[image.clone(), image.clone()], &sensor);
        let same = set(&simulated).against(&set(&simulated), Draws { count: 0, seed: 0 });
        assert!(same[1].value.abs() < 1e-12 && same[2].value == 0.0);
        Ok(())
    }
}
