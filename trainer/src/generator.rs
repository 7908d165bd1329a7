//! From a simulated scan to what the sensor would have measured: what every trained network does, whatever it is made of.

mod phased;

use burn::tensor::{Device, Tensor, TensorData, s};
use lidar::RangeImage;
use lidar::ray_drop::{RayDrop, uniform};

use crate::network::scatter::laplace;
use crate::network::{Measurement, UNet};

pub use phased::Phased;

/// The channel of the contract's noise that reflectances are drawn by.
const SCATTER: u32 = 1;

/// A network in physical units.
pub trait Generator {
    /// What the sensor measures of whole turns; `scan` is `[batch, 3, ring, column]` as `proto::card::tensor` says.
    fn measure(&self, scan: Tensor<4>) -> Measurement;
}

impl Generator for UNet {
    fn measure(&self, scan: Tensor<4>) -> Measurement {
        self.forward(scan)
    }
}

/// Answers a scan with itself.
#[derive(Clone, Copy, Debug)]
pub struct PassThrough;

impl Generator for PassThrough {
    fn measure(&self, scan: Tensor<4>) -> Measurement {
        let channel = |i: usize| scan.clone().slice(s![.., i..i + 1, .., ..]);
        let keep = channel(0).greater_elem(0.0).float();
        Measurement { range_m: channel(0), reflectance: channel(1), keep, scatter: None }
    }
}

/// A network's answer to one image, each channel `[ring, column]`.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Range in metres.
    pub range_m: Vec<f32>,
    /// Reflectance, 0–1.
    pub reflectance: Vec<f32>,
    /// Probability that the ray is reported.
    pub keep: Vec<f32>,
    /// Mean distance of reported reflectances from that one, where the network says it; they follow Laplace's distribution.
    pub scatter: Option<Vec<f32>>,
}

/// What a generator makes of scans, each scan's rays drawn once, with its number as seed.
pub fn answers(network: &impl Generator, scans: &[RangeImage]) -> Vec<RangeImage> {
    let answer = |(seed, image): (u64, &RangeImage)| Answer::new(network, image, &Device::flex()).drawn(image, seed);
    (0..).zip(scans).map(answer).collect()
}

impl Answer {
    /// A network's answer to an image.
    pub fn new(network: &impl Generator, image: &RangeImage, device: &Device) -> Self {
        let (rings, columns) = (image.rings(), image.columns());
        let mut scan = vec![0.0; 3 * rings * columns];
        image.write_tensor(&mut scan);
        let scan = Tensor::<4>::from_data(TensorData::new(scan, [1, 3, rings, columns]), device);
        let measured = network.measure(scan);
        let values = |x: Tensor<4>| x.into_data().iter::<f32>().collect();
        Self {
            range_m: values(measured.range_m),
            reflectance: values(measured.reflectance),
            keep: values(measured.keep),
            scatter: measured.scatter.map(values),
        }
    }

    /// One of the scans that the sensor could have measured of `simulated`, as the service draws it if the card names no bursts.
    pub fn drawn(&self, simulated: &RangeImage, seed: u64) -> RangeImage {
        let mut keep = vec![];
        RayDrop::default().sample(seed, simulated, &self.keep, &mut keep);
        let reflectance = self.reflectances(seed, simulated.columns());
        let mut out = simulated.clone();
        for (i, keep) in keep.into_iter().enumerate() {
            if keep && simulated.range_m()[i] > 0.0 && self.range_m[i] > 0.0 && self.range_m[i].is_finite() {
                out.set(i, self.range_m[i], reflectance[i], simulated.class()[i]);
            } else {
                out.remove(i);
            }
        }
        out
    }

    /// Reflectances with their scatter, if they have any.
    fn reflectances(&self, seed: u64, columns: usize) -> Vec<f32> {
        let Some(scatter) = &self.scatter else { return self.reflectance.clone() };
        let mut noise = vec![0.0; scatter.len()];
        uniform(seed, SCATTER, columns, &mut noise);
        let noise = laplace(Tensor::from_data(TensorData::new(noise, [1, 1, 1, scatter.len()]), &Device::flex()));
        let noise = noise.into_data();
        let drawn = self.reflectance.iter().zip(scatter).zip(noise.iter::<f32>());
        drawn.map(|((middle, scale), off)| (middle + scale * off).clamp(0.0, 1.0)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_rays_are_drawn_as_the_answer_says_and_none_where_the_simulation_has_none() {
        let mut simulated = RangeImage::from_channels(1000, vec![5.0; 2000], vec![0.5; 2000], vec![9; 2000]);
        (0..500).for_each(|i| simulated.remove(i));
        let answer =
            Answer { range_m: vec![5.1; 2000], reflectance: vec![0.25; 2000], keep: vec![0.8; 2000], scatter: None };
        let drawn = answer.drawn(&simulated, 4);
        assert!(drawn.range_m()[..500].iter().all(|r| *r == 0.0));
        // 1200 of 1500 are expected; four standard deviations to either side.
        assert!((1138..1262).contains(&drawn.returns()), "{}", drawn.returns());
        let kept = drawn.range_m().iter().position(|r| *r > 0.0).unwrap_or_default();
        assert_eq!((drawn.range_m()[kept], drawn.reflectance()[kept], drawn.class()[kept]), (5.1, 0.25, 9));
    }
}
