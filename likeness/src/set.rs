//! A set of scans, summed up so that it can be compared with others, and drawn from again and again.

use lidar::{RangeImage, Sensor};
use rayon::prelude::*;

use crate::bootstrap::Draws;
use crate::chamfer::chamfer_of_few;
use crate::farthest::farthest_points;
use crate::frechet::{FRECHET, frechet};
use crate::kernel::{KID, Table, discrepancy, polynomial_tables, unbiased_discrepancy};
use crate::matching::{MMD_MATCHING, POINTS, minimum_matching};
use crate::metric::{Metric, Score};
use crate::points::{Point, returns};
use crate::pyramid::{Border, Plane};
use crate::sliced::{Length, SLICED, Scale, Slicer, Slices};
use crate::{bev, ray_loss, reflectance, voxels};

/// Reach of the voxels, in metres.
const REACH_M: f32 = 120.0;

/// Seed of patches and directions: the same for every set, so that sets can be compared.
const SLICER_SEED: u64 = 12;

/// Samples of a network's features that a scan gives, each as long as the others.
pub type Features = Vec<Vec<f64>>;

/// Scans of one sensor.
#[derive(Clone, Debug)]
pub struct Set {
    scans: Vec<Scan>,
    slicer: Slicer,
}

#[derive(Clone, Debug)]
struct Scan {
    voxels: Vec<u32>,
    bev: Vec<u32>,
    few: Vec<Point>,
    reflectance: Vec<u32>,
    returned: Vec<f64>,
    slices: Slices,
    features: Features,
}

impl Set {
    /// Sums up scans of a sensor; `features` are what a network sees in each of them.
    ///
    /// # Panics
    /// If there is no scan, not features for each, or a scan has not the sensor's size, which is at least 28 × 28.
    pub fn new(images: &[RangeImage], features: Vec<Features>, sensor: &Sensor) -> Self {
        assert!(!images.is_empty() && images.len() == features.len(), "features of each scan");
        let slicer = Slicer::new(Border::Turn, Length::One, SLICER_SEED);
        let one = |(number, (image, features)): (usize, (&RangeImage, Features))| {
            let points = returns(image, sensor);
            let code = image.range_m().iter().map(|range_m| (range_m + 1.0).log2()).collect();
            Scan {
                voxels: voxels::count(&points, REACH_M),
                bev: bev::count(&points),
                few: farthest_points(&points, POINTS),
                reflectance: reflectance::count(image),
                returned: ray_loss::returned(image),
                slices: slicer.slice(Plane { columns: image.columns(), values: code }, number),
                features,
            }
        };
        let scans = images.par_iter().zip(features).enumerate().map(one).collect();
        Self { scans, slicer }
    }

    /// How many scans.
    pub fn len(&self) -> usize {
        self.scans.len()
    }

    /// Never: a set has a scan.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Every metric of these scans against real ones, with intervals over scans of both.
    pub fn against(&self, real: &Self, draws: Draws) -> Vec<Score> {
        let score = |metric: Metric, statistic: &(dyn Fn(&[usize], &[usize]) -> f64 + Sync)| {
            let found = draws.of_two([self.len(), real.len()], statistic);
            let (scans, against) = (self.len(), real.len());
            Score { metric, value: found.value, ci95: found.ci95, scans, against, floor: None }
        };
        let [aa, bb, ab] =
            polynomial_tables(&self.each(|s| s.features.as_slice()), &real.each(|s| s.features.as_slice()));
        let bev =
            |a: &Self, b: &Self| Table::new(a.len(), b.len(), |i, j| bev::kernel(&a.scans[i].bev, &b.scans[j].bev));
        let [bev_aa, bev_bb, bev_ab] = [bev(self, self), bev(real, real), bev(self, real)];
        let chamfer = Table::new(self.len(), real.len(), |i, j| chamfer_of_few(&self.scans[i].few, &real.scans[j].few));
        vec![
            score(FRECHET, &|a, b| {
                let samples = |set: &Self, of: &[usize]| -> Vec<Vec<f64>> {
                    of.iter().flat_map(|i| set.scans[*i].features.iter().cloned()).collect()
                };
                let (a, b) = (samples(self, a), samples(real, b));
                frechet(&slices_of(&a), &slices_of(&b))
            }),
            score(KID, &|a, b| unbiased_discrepancy([&aa, &bb, &ab], a, b)),
            score(SLICED, &|a, b| {
                self.slicer.distance(&self.drawn(a, |s| &s.slices), &real.drawn(b, |s| &s.slices), Scale::OfSecond)
            }),
            score(voxels::JSD_VOXEL_BITS, &|a, b| {
                voxels::jsd_bits(self.drawn(a, |s| s.voxels.as_slice()), real.drawn(b, |s| s.voxels.as_slice()))
            }),
            score(bev::JSD_BEV_ROOT_NATS, &|a, b| {
                bev::jsd_root_nats(self.drawn(a, |s| s.bev.as_slice()), real.drawn(b, |s| s.bev.as_slice()))
            }),
            score(MMD_MATCHING, &|a, b| minimum_matching(&chamfer, a, b)),
            score(bev::MMD_KERNEL, &|a, b| discrepancy([&bev_aa, &bev_bb, &bev_ab], a, b)),
            score(reflectance::REFLECTANCE_W1, &|a, b| {
                reflectance::wasserstein_1(
                    self.drawn(a, |s| s.reflectance.as_slice()),
                    real.drawn(b, |s| s.reflectance.as_slice()),
                )
            }),
            score(ray_loss::EMPTY_SHARE, &|a, b| {
                ray_loss::difference(
                    &self.drawn(a, |s| s.returned.as_slice()),
                    &real.drawn(b, |s| s.returned.as_slice()),
                )
            }),
        ]
    }

    fn each<'a, T>(&'a self, of: impl Fn(&'a Scan) -> T) -> Vec<T> {
        self.scans.iter().map(of).collect()
    }

    fn drawn<'a, T>(&'a self, which: &[usize], of: impl Fn(&'a Scan) -> T) -> Vec<T> {
        which.iter().map(|i| of(&self.scans[*i])).collect()
    }
}

fn slices_of(samples: &[Vec<f64>]) -> Vec<&[f64]> {
    samples.iter().map(Vec::as_slice).collect()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Walls around a sensor, at a distance that differs from scan to scan; `lost` of the rays do not come back.
    fn walls(seed: u64, range_m: f32, reflectance: f32, lost: f64) -> RangeImage {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let range_m = range_m * rng.random_range(0.9..1.1f32);
        let mut image = RangeImage::empty(32, 64);
        for i in 0..32 * 64 {
            if !rng.random_bool(lost) {
                image.set(i, range_m * rng.random_range(0.99..1.01f32), reflectance, 0);
            }
        }
        image
    }

    #[test]
    fn another_distance_reflectance_or_loss_shows_in_the_metrics_that_are_about_it()
    -> Result<(), Box<dyn std::error::Error>> {
        let sensor = Sensor::builtin("hdl32e")?.with_columns(64)?;
        let set = |first: u64, range_m, reflectance, lost| {
            let images: Vec<RangeImage> = (first..first + 6).map(|s| walls(s, range_m, reflectance, lost)).collect();
            // What a network might see: mean range and share of returns, of both halves.
            let features = images.iter().map(|image| {
                let half = |k: usize| {
                    let rows = image.range_m()[k * 1024..(k + 1) * 1024].iter();
                    vec![f64::from(rows.clone().sum::<f32>()) / 1e4, rows.filter(|r| **r > 0.0).count() as f64 / 1024.0]
                };
                vec![half(0), half(1)]
            });
            Set::new(&images, features.collect(), &sensor)
        };
        let real = set(0, 20.0, 0.3, 0.1);
        let scores = |other: &Set| {
            let of = other.against(&real, Draws { count: 50, seed: 1 });
            of.into_iter().map(|s| (s.metric.name, s)).collect::<std::collections::HashMap<_, _>>()
        };
        let (alike, far) = (scores(&set(10, 20.0, 0.3, 0.1)), scores(&set(10, 30.0, 0.3, 0.1)));
        let (dark, lossy) = (scores(&set(10, 20.0, 0.1, 0.1)), scores(&set(10, 20.0, 0.3, 0.4)));
        assert_eq!(alike.len(), 9);
        let value = |of: &std::collections::HashMap<&str, Score>, metric: Metric| of[metric.name].value;
        for metric in
            [voxels::JSD_VOXEL_BITS, bev::JSD_BEV_ROOT_NATS, bev::MMD_KERNEL, MMD_MATCHING, SLICED, FRECHET, KID]
        {
            assert!(value(&far, metric) > 2.0 * value(&alike, metric).abs(), "{}", metric.name);
        }
        let w1 = reflectance::REFLECTANCE_W1;
        assert!(value(&alike, w1) < 1e-9 && (value(&dark, w1) - 0.2).abs() < 1e-9);
        let loss = ray_loss::EMPTY_SHARE;
        assert!(value(&alike, loss) < 0.03 && (value(&lossy, loss) - 0.3).abs() < 0.02);
        let ci95 = far[SLICED.name].ci95.unwrap_or_default();
        assert!(ci95[0] < value(&far, SLICED) && value(&far, SLICED) < ci95[1], "{ci95:?}");
        Ok(())
    }
}
