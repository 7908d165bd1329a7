//! A generator from simulated to real, as it is asked.

use burn::tensor::Device;
use lidar::birds_eye::BirdsEye;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::cycle_gan::{answer, occupied};
use super::detector::tensor;
use super::sampler::{coded, decoded};
use crate::network::Resnet;
use crate::translation::sampler::uniform;

/// The generator, on the processor.
#[derive(Debug)]
pub struct Translator {
    network: Resnet,
    ray_drop: bool,
}

impl Translator {
    /// A generator that, where it has `ray_drop`, says which cells are lost.
    pub fn new(network: Resnet, ray_drop: bool) -> Self {
        Self { network, ray_drop }
    }

    /// What a real sensor would have shown; lost cells are drawn by this seed.
    pub fn translate(&self, scan: &BirdsEye, seed: u64) -> BirdsEye {
        let code = coded(tensor(std::slice::from_ref(scan), &Device::flex()));
        let generated = self.network.forward(code.clone(), &code);
        let possible = self.ray_drop.then(|| {
            let drawn = uniform([1, scan.cells, scan.cells], &mut ChaCha8Rng::seed_from_u64(seed), &Device::flex());
            (occupied(&code), drawn)
        });
        let values = decoded(answer(&generated, possible)).into_data().iter::<f32>().collect();
        BirdsEye { cells: scan.cells, values }
    }
}
