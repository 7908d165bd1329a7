//! Earlier answers that a discriminator is shown again, so that it does not forget what it could tell: Shrivastava et al., "Learning from
//! simulated and unsupervised images through adversarial training" (2017).

use anyhow::{Result, ensure};
use burn::tensor::{Tensor, TensorData};
use rand::{Rng, RngExt};

/// Answers, each `[2, ring, column]`.
#[derive(Clone, Debug)]
pub struct Pool {
    size: usize,
    images: Vec<Vec<f32>>,
}

impl Pool {
    /// A pool of at most so many answers; of none, if answers are to be shown as they come.
    pub fn new(size: usize) -> Self {
        Self { size, images: vec![] }
    }

    /// As many answers as are given, half of them earlier ones, once the pool is full; those that are not shown stay in it.
    pub fn exchange(&mut self, answers: Tensor<4>, rng: &mut impl Rng) -> Tensor<4> {
        let (size, device) = (answers.dims(), answers.device());
        let mut values: Vec<f32> = answers.detach().into_data().iter::<f32>().collect();
        for image in values.chunks_mut(size[1] * size[2] * size[3]) {
            if self.images.len() < self.size {
                self.images.push(image.to_vec());
            } else if self.size > 0 && rng.random_bool(0.5) {
                let place = rng.random_range(0..self.size);
                image.swap_with_slice(&mut self.images[place]);
            }
        }
        Tensor::from_data(TensorData::new(values, size), &device)
    }

    /// The answers, one after the other, as little-endian float32.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.images.iter().flatten().flat_map(|value| value.to_le_bytes()).collect()
    }

    /// The same pool with the answers of [`to_bytes`](Self::to_bytes), each of so many numbers.
    pub fn with_bytes(&self, bytes: &[u8], numbers: usize) -> Result<Self> {
        let (bytes_each, found) = (4 * numbers, bytes.len());
        ensure!(
            found.is_multiple_of(bytes_each) && found / bytes_each <= self.size,
            "a pool of {found} bytes, expected at most {} times {bytes_each}",
            self.size
        );
        let values: Vec<f32> = bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        Ok(Self { size: self.size, images: values.chunks(numbers).map(<[f32]>::to_vec).collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn exchange(pool: &mut Pool, value: f32, rng: &mut ChaCha8Rng) -> f32 {
        pool.exchange(Tensor::full([1, 2, 1, 3], value, &Device::flex()), rng).into_data().iter::<f32>().sum::<f32>()
            / 6.0
    }

    #[test]
    fn a_full_pool_shows_earlier_answers_half_of_the_time() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut pool = Pool::new(5);
        assert!((0..5).all(|i| exchange(&mut pool, i as f32, &mut rng) == i as f32));
        let earlier = (5..205).filter(|i| exchange(&mut pool, *i as f32, &mut rng) < *i as f32).count();
        assert!((72..128).contains(&earlier), "{earlier} of 200: half, within four standard deviations");
    }

    #[test]
    fn a_pool_comes_back_from_its_bytes() -> Result<()> {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut pool = Pool::new(3);
        (0..4).for_each(|i| {
            exchange(&mut pool, i as f32, &mut rng);
        });
        assert_eq!(Pool::new(3).with_bytes(&pool.to_bytes(), 6)?.images, pool.images);
        assert!(Pool::new(2).with_bytes(&pool.to_bytes(), 6).is_err(), "more than it takes");
        assert!(Pool::new(3).with_bytes(&pool.to_bytes()[1..], 6).is_err(), "cut off");
        Ok(())
    }

    #[test]
    fn without_a_pool_answers_are_shown_as_they_come() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut pool = Pool::new(0);
        assert!((0..9).all(|i| exchange(&mut pool, i as f32, &mut rng) == i as f32));
    }
}
