//! Made-up streets, spoilt: what a network learns from them must not be that made-up scans are clean.

use anyhow::Result;
use lidar::projection::NO_PIXEL;
use lidar::{Projector, RangeImage, Sensor};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, cast};

/// Standard deviation of the range, m: what data sheets of spinning lidars say.
const RANGE_NOISE_M: f32 = 0.02;

/// Standard deviations of the natural logarithm of the reflectance: of a ring's gain, and of one return's speckle.
const RING_GAIN: f32 = 0.2;
const SPECKLE: f32 = 0.3;

/// Makes spoilt streets.
#[derive(Clone, Debug)]
pub struct Streets {
    sensor: Sensor,
    /// The grid through which half of the scans go.
    coarse: Option<Projector>,
    seed: u64,
}

impl Streets {
    /// Streets scanned by a sensor. Half of the scans lose the points that a projection by elevation to the rings of `coarse` loses, as
    /// labelled real scans did that were published in such a projection.
    pub fn new(sensor: &Sensor, coarse: Option<&Sensor>, seed: u64) -> Self {
        Self { sensor: sensor.clone(), coarse: coarse.map(|sensor| Projector::new(sensor).by_elevation()), seed }
    }

    /// The scan of street `k`: range noise; reflectance with an unknown gain a ring, the cosine of the incidence in part, and speckle;
    /// rays lost here and there, more of them far away and at grazing incidence.
    pub fn scan(&mut self, k: u64) -> Result<RangeImage> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(k);
        let world = street(self.seed.wrapping_mul(1 << 32).wrapping_add(k), &StreetConfig::default());
        let cast = cast(&world, &self.sensor, &Pose::default(), &Motion::default());
        let mut image = cast.image;
        let normal = |deviation| Normal::new(0.0f32, deviation).unwrap_or_else(|_| unreachable!("a positive number"));
        let (ring_gain, speckle, noise) = (normal(RING_GAIN), normal(SPECKLE), normal(RANGE_NOISE_M));
        let gain = rng.random_range(0.5..1.2f32);
        let lost_anyhow = rng.random_range(0.01..0.12f32);
        let lost_far = rng.random_range(0.2..0.8f32);
        for ring in 0..image.rings() {
            let gain = gain * ring_gain.sample(&mut rng).exp();
            for i in ring * image.columns()..(ring + 1) * image.columns() {
                let range_m = image.range_m()[i];
                if range_m == 0.0 {
                    continue;
                }
                let cosine = cast.incidence_rad[i].cos();
                let lost = lost_anyhow + lost_far * (1.0 - cosine) * (range_m / 60.0).min(1.0);
                if rng.random::<f32>() < lost {
                    image.remove(i);
                    continue;
                }
                let reflectance = image.reflectance()[i] * gain * (0.5 + 0.5 * cosine) * speckle.sample(&mut rng).exp();
                let class = image.class()[i];
                image.set(i, (range_m + noise.sample(&mut rng)).max(0.1), reflectance.clamp(0.0, 1.0), class);
            }
        }
        match &mut self.coarse {
            Some(coarse) if rng.random_bool(0.5) => thin_out(image, &self.sensor, coarse),
            _ => Ok(image),
        }
    }
}

/// Removes the returns that lose their pixel on another sensor's grid.
pub(super) fn thin_out(mut image: RangeImage, sensor: &Sensor, coarse: &mut Projector) -> Result<RangeImage> {
    let returns: Vec<usize> = (0..image.range_m().len()).filter(|i| image.range_m()[*i] > 0.0).collect();
    let projection = coarse.project(&image.to_cloud(sensor))?;
    for (i, pixel) in returns.into_iter().zip(projection.pixel_of_point) {
        if pixel == NO_PIXEL {
            image.remove(i);
        }
    }
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spoilt_street_is_labelled_noisy_and_full_of_holes() -> Result<()> {
        let sensor = Sensor::builtin("hdl64e")?.with_columns(256)?;
        let uniform = Sensor::builtin("hdl64e-uniform")?.with_columns(256)?;
        let clean = cast(&street(0, &StreetConfig::default()), &sensor, &Pose::default(), &Motion::default()).image;
        let whole = Streets::new(&sensor, None, 0).scan(0)?;
        let lost = 1.0 - whole.returns() as f64 / clean.returns() as f64;
        assert!((0.01..0.5).contains(&lost), "{lost}");
        let kept = || (0..whole.range_m().len()).filter(|i| whole.range_m()[*i] > 0.0);
        assert!(kept().all(|i| whole.class()[i] == clean.class()[i]));
        let off: f64 = kept().map(|i| f64::from((whole.range_m()[i] - clean.range_m()[i]).powi(2))).sum();
        let off_m = (off / whole.returns() as f64).sqrt();
        assert!((off_m - f64::from(RANGE_NOISE_M)).abs() < 0.1 * f64::from(RANGE_NOISE_M), "{off_m}");
        // Upper rings are 0.335° apart and the uniform grid's 0.444°: a quarter of their returns share a pixel with another.
        let mut streets = Streets::new(&sensor, Some(&uniform), 0);
        let thinned: Vec<usize> = (0..6).map(|k| streets.scan(k).map(|s| s.returns())).collect::<Result<_>>()?;
        let mut streets = Streets::new(&sensor, None, 0);
        let whole: Vec<usize> = (0..6).map(|k| streets.scan(k).map(|s| s.returns())).collect::<Result<_>>()?;
        let share = thinned.iter().zip(whole).map(|(a, b)| *a as f64 / b as f64);
        let (untouched, thinned): (Vec<f64>, Vec<f64>) = share.partition(|share| *share == 1.0);
        assert!(!untouched.is_empty() && !thinned.is_empty());
        assert!(thinned.iter().all(|share| (0.75..0.95).contains(share)), "{thinned:?}");
        Ok(())
    }
}
