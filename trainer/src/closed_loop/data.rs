//! A paired set as batches of tensors.

use burn::tensor::{Device, Tensor, TensorData};
use lidar::{RangeImage, Sensor};

use super::likelihood::Observed;
use crate::effects::{Image, Rays, Simulated};

/// Pixels that a batch should have: enough to keep the kernels busy, few enough for the caches.
const BATCH_PIXELS: usize = 1 << 14;

/// One frame: a simulated scan and what the sensor measured in its place.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Number of the frame within the set.
    pub frame: usize,
    /// Number of its scene.
    pub scene: usize,
    /// What the current generator makes of the simulated scan; without one, the scan as it is.
    pub simulated: RangeImage,
    /// Probability that each ray is reported, by the generator; `None` = 1 throughout.
    pub keep: Option<Vec<f32>>,
    /// The measured scan.
    pub measured: RangeImage,
}

/// Consecutive frames of one scene.
#[derive(Clone, Debug)]
pub struct Batch {
    /// Numbers of the frames.
    pub frames: Vec<usize>,
    /// Number of their scene.
    pub scene: usize,
    /// The image of an ideal sensor.
    pub image: Image,
    /// What was measured.
    pub observed: Observed,
}

/// Makes batches, no batch across two scenes.
pub fn batches(pairs: &[&Pair], sensor: &Sensor, device: &Device) -> Vec<Batch> {
    let rays = Rays::new(sensor, device);
    let most = (BATCH_PIXELS / sensor.pixels()).max(1);
    let mut out = Vec::new();
    for scene in pairs.chunk_by(|a, b| a.scene == b.scene) {
        for some in scene.chunks(most) {
            out.push(batch(some, sensor, &rays, device));
        }
    }
    out
}

fn batch(pairs: &[&Pair], sensor: &Sensor, rays: &Rays, device: &Device) -> Batch {
    let size = [pairs.len(), sensor.rings().len(), sensor.columns()];
    let tensor = |of: &dyn Fn(&Pair) -> Vec<f32>| {
        let values: Vec<f32> = pairs.iter().flat_map(|pair| of(pair)).collect();
        Tensor::<3>::from_data(TensorData::new(values, size), device)
    };
    let frames: Vec<f32> = pairs.iter().map(|p| p.frame as f32).collect();
    let simulated = Simulated {
        range_m: tensor(&|p| p.simulated.range_m().to_vec()),
        reflectance: tensor(&|p| p.simulated.reflectance().to_vec()),
        class: tensor(&|p| p.simulated.class().iter().map(|c| f32::from(*c)).collect()),
        keep: if pairs.iter().all(|p| p.keep.is_none()) {
            Tensor::ones([1, 1, 1], device)
        } else {
            tensor(&|p| p.keep.clone().unwrap_or_else(|| vec![1.0; sensor.pixels()]))
        },
        frame: Tensor::from_data(TensorData::new(frames, [pairs.len(), 1, 1]), device),
    };
    let observed =
        Observed::new(tensor(&|p| p.measured.range_m().to_vec()), tensor(&|p| p.measured.reflectance().to_vec()));
    Batch {
        frames: pairs.iter().map(|p| p.frame).collect(),
        scene: pairs[0].scene,
        image: Image::new(simulated, rays.clone()),
        observed,
    }
}
