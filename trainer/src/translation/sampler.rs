//! Batches of both domains; the same step gives the same batch, whenever it is drawn.

use burn::tensor::{Device, Tensor, TensorData};
use lidar::RangeImage;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::augment::Augmentation;
use super::domain::Domain;
use super::twins::Disguise;

/// What chance decides in a step; each has random numbers of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chance {
    /// Which simulated scans are shown, and how they are varied.
    Simulated,
    /// Which real ones.
    Real,
    /// Which rays are reported; one generator after the other.
    RayDrop(u8),
    /// Which reflectances; one generator after the other.
    Scatter(u8),
    /// Which real ones are made to look simulated, and how.
    Twins,
    /// Which places are compared.
    Places,
    /// Which of the earlier answers a discriminator is shown.
    Pool,
}

impl Chance {
    /// The random numbers of a step, which depend on nothing else.
    pub fn of(self, seed: u64, step: usize) -> ChaCha8Rng {
        let number = match self {
            Self::Simulated => 0,
            Self::Real => 1,
            Self::Places => 2,
            Self::Pool => 3,
            Self::RayDrop(generator) => 4 + u64::from(generator),
            Self::Scatter(generator) => 1 << 14 | u64::from(generator),
            Self::Twins => 1 << 15,
        };
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream((step as u64) << 16 | number);
        rng
    }
}

/// Uniform numbers from 0 to 1, `[batch, 1, ring, column]`.
pub fn uniform([batch, rings, columns]: [usize; 3], rng: &mut ChaCha8Rng, device: &Device) -> Tensor<4> {
    let values: Vec<f32> = (0..batch * rings * columns).map(|_| rng.random::<f32>()).collect();
    Tensor::from_data(TensorData::new(values, [batch, 1, rings, columns]), device)
}

/// As many simulated scans as real ones, in physical units, each `[batch, 3, ring, column]`.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Simulated.
    pub simulated: Tensor<4>,
    /// Real; of other places.
    pub real: Tensor<4>,
}

/// Draws batches.
#[derive(Clone, Debug)]
pub struct Sampler {
    /// Simulated scans.
    pub simulated: Domain,
    /// Real scans.
    pub real: Domain,
    /// Of all random numbers.
    pub seed: u64,
    /// Scans of each domain a step.
    pub batch: usize,
    /// Columns of a cut-out.
    pub crop_columns: usize,
    /// How scans are varied.
    pub augmentation: Augmentation,
    /// How real scans are made to look simulated; `None` where nothing is learned from that.
    pub disguise: Option<Disguise>,
}

impl Sampler {
    /// The batch of a step.
    pub fn pair(&self, step: usize, device: &Device) -> Pair {
        let cut = |domain: &Domain, rng: &mut ChaCha8Rng| {
            let image = &domain.images[rng.random_range(0..domain.images.len())];
            self.augmentation.cut(image, self.crop_columns, rng)
        };
        let batch = |domain: &Domain, mut rng: ChaCha8Rng| {
            let images: Vec<_> = (0..self.batch).map(|_| cut(domain, &mut rng)).collect();
            scans(&images, device)
        };
        Pair {
            simulated: batch(&self.simulated, Chance::Simulated.of(self.seed, step)),
            real: batch(&self.real, Chance::Real.of(self.seed, step)),
        }
    }
}

/// Images of one size as `[batch, 3, ring, column]`: range in m, reflectance, class.
///
/// # Panics
/// If there is none.
pub fn scans(images: &[RangeImage], device: &Device) -> Tensor<4> {
    let (rings, columns) = (images[0].rings(), images[0].columns());
    let mut values = vec![0.0; images.len() * 3 * rings * columns];
    for (image, out) in images.iter().zip(values.chunks_mut(3 * rings * columns)) {
        image.write_tensor(out);
    }
    Tensor::from_data(TensorData::new(values, [images.len(), 3, rings, columns]), device)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampler(seed: u64) -> Sampler {
        let image = |from: f32| {
            let range_m = (0..4 * 32).map(|i| from + i as f32).collect();
            RangeImage::from_channels(32, range_m, vec![0.5; 128], vec![1; 128])
        };
        let domain = |from: f32| Domain { images: vec![image(from), image(from + 200.0)], datasets: vec![] };
        let (simulated, real) = (domain(1000.0), domain(5000.0));
        Sampler {
            simulated,
            real,
            seed,
            batch: 3,
            crop_columns: 16,
            augmentation: Augmentation::default(),
            disguise: None,
        }
    }

    fn values(x: Tensor<4>) -> Vec<f32> {
        x.into_data().iter::<f32>().collect()
    }

    #[test]
    fn a_steps_batch_depends_on_seed_and_step_alone() {
        let device = Device::flex();
        let pair = |seed, step| {
            let pair = sampler(seed).pair(step, &device);
            assert_eq!(pair.simulated.dims(), [3, 3, 4, 16]);
            (values(pair.simulated), values(pair.real))
        };
        assert_eq!(pair(1, 5), pair(1, 5));
        assert_ne!(pair(1, 5), pair(1, 6));
        assert_ne!(pair(1, 5), pair(2, 5));
    }

    #[test]
    fn each_domain_shows_its_own_scans() {
        let device = Device::flex();
        let pair = sampler(3).pair(0, &device);
        let range_m = |x: &Tensor<4>| values(x.clone().slice(burn::tensor::s![.., 0..1, .., ..]));
        assert!(range_m(&pair.simulated).iter().all(|r| (1000.0..1400.0).contains(r)));
        assert!(range_m(&pair.real).iter().all(|r| (5000.0..5400.0).contains(r)));
    }

    #[test]
    fn what_chance_decides_is_decided_apart() {
        let device = Device::flex();
        let of = |chance: Chance| values(uniform([1, 4, 8], &mut chance.of(1, 0), &device));
        assert_ne!(of(Chance::RayDrop(0)), of(Chance::RayDrop(1)));
        assert_ne!(of(Chance::Simulated), of(Chance::Real));
    }
}
