//! Cut-outs to learn from: a batch depends on (seed, step) alone.

use burn::tensor::{Device, Tensor, TensorData};
use lidar::{RangeImage, Sensor};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::classes::{CLASSES, merged};
use super::input;
use crate::data::scans::cut_columns;

/// Cuts labelled scans.
#[derive(Clone, Debug)]
pub struct Sampler {
    /// Scans of each kind; every kind is drawn as often as the others, however few scans it has.
    kinds: Vec<Vec<RangeImage>>,
    sensor: Sensor,
    class_weights: [f32; CLASSES],
    seed: u64,
    batch: usize,
    crop_columns: usize,
}

/// What one step learns from.
#[derive(Clone, Debug)]
pub struct Batch {
    /// See [`input`].
    pub scan: Tensor<4>,
    /// The weight of the pixel's class in that class's channel, 0 in the others and where there is no label; `[batch, class, ring, column]`.
    pub target: Tensor<4>,
}

impl Sampler {
    /// A sampler over these kinds of scans, none of them empty.
    pub fn new(kinds: Vec<Vec<RangeImage>>, sensor: &Sensor, seed: u64, batch: usize, crop_columns: usize) -> Self {
        let class_weights = class_weights(kinds.iter().flatten());
        Self { kinds, sensor: sensor.clone(), class_weights, seed, batch, crop_columns }
    }

    /// The batch of a step: from random azimuths on, mirrored half of the time, a third of the cut-outs at half the number of columns.
    pub fn batch(&self, step: usize, device: &Device) -> Batch {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(step as u64 + 1);
        let cuts: Vec<RangeImage> = (0..self.batch)
            .map(|_| {
                let kind = &self.kinds[rng.random_range(0..self.kinds.len())];
                let image = &kind[rng.random_range(0..kind.len())];
                let from = rng.random_range(0..image.columns());
                if rng.random_bool(1.0 / 3.0) {
                    cut_columns(image, from, 2 * self.crop_columns).resample_columns(self.crop_columns)
                } else {
                    cut_columns(image, from, self.crop_columns)
                }
            })
            .collect();
        let scan = input::tensor(&cuts, &self.sensor, device);
        let [batch, _, rings, columns] = scan.dims();
        let mut target = vec![0.0; batch * CLASSES * rings * columns];
        for (image, out) in cuts.iter().zip(target.chunks_mut(CLASSES * rings * columns)) {
            for (i, class) in image.class().iter().enumerate() {
                if let Some(class) = merged(*class) {
                    out[class * rings * columns + i] = self.class_weights[class];
                }
            }
        }
        let target = Tensor::from_data(TensorData::new(target, [batch, CLASSES, rings, columns]), device);
        if rng.random_bool(0.5) {
            Batch { scan: scan.flip([3]), target: target.flip([3]) }
        } else {
            Batch { scan, target }
        }
    }
}

/// One over the square root of each class's share: a trunk counts for more than a patch of road, but not as much as all the road.
fn class_weights<'a>(scans: impl IntoIterator<Item = &'a RangeImage>) -> [f32; CLASSES] {
    let mut count = [0u64; CLASSES];
    for class in scans.into_iter().flat_map(RangeImage::class).filter_map(|class| merged(*class)) {
        count[class] += 1;
    }
    let total: u64 = count.iter().sum();
    count.map(|count| if count == 0 { 0.0 } else { (total as f32 / count as f32).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_batch_depends_on_its_step_alone_and_unlabelled_pixels_teach_nothing() -> Result<(), Box<dyn std::error::Error>>
    {
        let sensor = Sensor::builtin("vlp16")?.with_columns(64)?;
        let class: Vec<u8> = (0..16 * 64).map(|i| if i % 3 == 0 { 0 } else { 9 + 4 * u8::from(i % 5 == 0) }).collect();
        let image = RangeImage::from_channels(64, vec![5.0; class.len()], vec![0.1; class.len()], class);
        let sampler = Sampler::new(vec![vec![image.clone()], vec![image]], &sensor, 1, 3, 32);
        let numbers = |x: Tensor<4>| x.into_data().iter::<f32>().collect::<Vec<f32>>();
        let target = |step| numbers(sampler.batch(step, &Device::flex()).target);
        assert_eq!(target(5), target(5));
        assert_ne!(target(5), target(6));
        // Roads (9) are four times as frequent as buildings (13), so a building weighs twice as much.
        let weight = |class: usize| sampler.class_weights[class];
        assert!((weight(4) / weight(2) - 2.0).abs() < 0.02, "{:?}", sampler.class_weights);
        let taught = target(5).iter().filter(|w| **w > 0.0).count();
        assert!(taught < 3 * 16 * 32 && taught > 3 * 16 * 32 / 2);
        Ok(())
    }
}
