//! Real scans made to look simulated, beside themselves: what can be learned in pairs where there are none.

use burn::tensor::{Device, Tensor, TensorData};
use lidar::RangeImage;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::sampler::{Chance, Sampler, scans};
use super::view::{Coding, View};
use crate::data::sample::{Sample, SimulatedReflectance};
use crate::evaluate::made_simulated;

/// A batch of them.
#[derive(Clone, Debug)]
pub struct Twins {
    /// Holes filled, and the reflectance of some simulator.
    pub shown: View,
    /// What the sensor measured.
    pub measured: View,
    /// Rays that each pixel stands for in the loss of the keep mask, `[batch, 1, ring, column]`.
    pub keep_weight: Tensor<4>,
}

/// How real scans are made to look simulated.
#[derive(Clone, Debug, Default)]
pub struct Disguise {
    /// Pixels that the sensor's own vehicle hides: of these nothing is asked.
    pub own_vehicle: Vec<usize>,
    /// The simulator's reflectance is e^(−a r), with this a in 1/m; `None`: whatever simulators may say.
    pub attenuation_per_m: Option<f32>,
    /// Whether real scans are labelled, so that simulators may know materials.
    pub labelled: bool,
}

impl Disguise {
    /// Whole scans to be scored on, with CARLA's reflectance.
    pub fn put_on_all(&self, real: &[RangeImage]) -> Vec<Sample> {
        made_simulated(real).map(|sample| sample.without(&self.own_vehicle)).collect()
    }

    fn put_on(&self, real: &RangeImage, rng: &mut ChaCha8Rng) -> Sample {
        let reflectance = match self.attenuation_per_m {
            Some(rate_per_m) => SimulatedReflectance::Attenuation(rate_per_m),
            None if self.labelled => SimulatedReflectance::random_where_labelled(rng),
            None => SimulatedReflectance::random(rng),
        };
        Sample::new(real.clone(), true, reflectance, rng).without(&self.own_vehicle)
    }
}

impl Sampler {
    /// The twins of a step: cut-outs of real scans, as many as of each domain; `None` where nothing is learned from them.
    pub fn twins(&self, step: usize, coding: Coding, device: &Device) -> Option<Twins> {
        let disguise = self.disguise.as_ref()?;
        let mut rng = Chance::Twins.of(self.seed, step);
        let samples: Vec<Sample> = (0..self.batch)
            .map(|_| {
                let real = &self.real.images[rng.random_range(0..self.real.images.len())];
                disguise.put_on(real, &mut rng).cut(
                    rng.random_range(0..real.columns()),
                    self.crop_columns,
                    rng.random_bool(0.5),
                )
            })
            .collect();
        let view = |image: fn(&Sample) -> &RangeImage| {
            let images: Vec<RangeImage> = samples.iter().map(|sample| image(sample).clone()).collect();
            coding.view(&scans(&images, device))
        };
        let (shown, measured) = (view(|sample| &sample.simulated), view(|sample| &sample.real));
        let keep_weight: Vec<f32> = samples.iter().flat_map(|sample| sample.keep_weight.iter().copied()).collect();
        let keep_weight = Tensor::from_data(TensorData::new(keep_weight, shown.returned.dims()), device);
        Some(Twins { shown, measured, keep_weight })
    }
}

#[cfg(test)]
mod tests {
    use anyhow::{Context, Result};
    use burn::tensor::s;

    use super::*;
    use crate::network::{RangeCode, RangeCoder};
    use crate::translation::augment::Augmentation;
    use crate::translation::{Domain, Unreported};

    const COLUMNS: usize = 32;

    /// A wall, a hole of one pixel in every fourth column; the lowest ring's first half hides behind the vehicle.
    fn sampler() -> Sampler {
        let mut image =
            RangeImage::from_channels(COLUMNS, vec![9.0; 4 * COLUMNS], vec![0.25; 4 * COLUMNS], vec![3; 4 * COLUMNS]);
        (0..3 * COLUMNS).step_by(4).for_each(|i| image.remove(i));
        let own_vehicle: Vec<usize> = (3 * COLUMNS..3 * COLUMNS + COLUMNS / 2).collect();
        for i in &own_vehicle {
            image.remove(*i);
        }
        let real = Domain { images: vec![image], datasets: vec![] };
        let disguise = Disguise { own_vehicle, attenuation_per_m: Some(0.1), labelled: false };
        let augmentation = Augmentation::default();
        Sampler {
            simulated: Domain::default(),
            real,
            seed: 4,
            batch: 3,
            crop_columns: COLUMNS,
            augmentation,
            disguise: Some(disguise),
        }
    }

    fn values(x: &Tensor<4>) -> Vec<f32> {
        x.clone().into_data().iter::<f32>().collect()
    }

    fn twins(step: usize) -> Result<Twins> {
        let range = RangeCoder { code: RangeCode::Logarithmic, limits_m: (0.9, 120.0) };
        sampler().twins(step, Coding { range, unreported: Unreported::MinusOne }, &Device::flex()).context("none")
    }

    #[test]
    fn what_is_lost_is_shown_and_of_what_the_vehicle_hides_nothing_is_asked() -> Result<()> {
        let Twins { shown, measured, keep_weight } = twins(0)?;
        let rows = |x: &Tensor<4>, ring: usize| values(&x.clone().slice(s![.., .., ring..ring + 1, ..]));
        for ring in 0..3 {
            let lost = rows(&measured.returned, ring).into_iter().zip(rows(&shown.returned, ring));
            assert!(lost.filter(|(measured, shown)| *measured == 0.0 && *shown == 1.0).count() > 0, "ring {ring}");
            assert!(rows(&keep_weight, ring).iter().sum::<f32>() > 0.0);
        }
        // Half of the lowest ring is hidden, and what is hidden is neither shown nor weighed.
        for channel in [&shown.returned, &keep_weight] {
            let seen = rows(channel, 3).iter().filter(|value| **value > 0.0).count();
            assert!(seen <= 3 * COLUMNS / 2, "{seen}");
        }
        Ok(())
    }

    #[test]
    fn a_steps_twins_depend_on_the_step_alone() -> Result<()> {
        assert_eq!(values(&twins(7)?.shown.image), values(&twins(7)?.shown.image));
        assert_ne!(values(&twins(7)?.shown.image), values(&twins(8)?.shown.image));
        Ok(())
    }
}
