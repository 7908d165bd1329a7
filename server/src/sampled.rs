//! What the sensor reports of each ray: the model's outputs, checked, with ray drop decided.

use lidar::ray_drop::RayDrop;
use lidar::{Measured, RangeImage};
use proto::card::{Card, tensor};
use thiserror::Error;

use crate::generator::{InferenceError, Outputs};

/// Range, reflectance and whether the ray is kept, each `[ring, column]`; keeps its memory from scan to scan.
#[derive(Debug, Default)]
pub(crate) struct Sampled {
    range_m: Vec<f32>,
    reflectance: Vec<f32>,
    keep: Vec<bool>,
    ray_drop: RayDrop,
}

/// A model that gave no number for a ray whose outputs count.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("the model gave NaN for {nan} of {rays} rays")]
pub struct NotANumber {
    /// Rays with a NaN in range, reflectance or keep.
    pub nan: usize,
    /// Rays whose outputs count: all where the model adds returns, otherwise those that have one in the simulated scan.
    pub rays: usize,
}

/// Outputs that cannot be used.
#[derive(Debug, Error)]
pub(crate) enum SampleError {
    #[error(transparent)]
    Outputs(#[from] InferenceError),
    #[error(transparent)]
    NotANumber(#[from] NotANumber),
}

impl Sampled {
    /// Draws what a model of this card says.
    pub(crate) fn new(card: &Card) -> Self {
        let ray_drop = RayDrop::new(card.drop_bursts.clone(), 360.0 / card.sensor.columns() as f64);
        Self { ray_drop, ..Self::default() }
    }

    /// Takes the outputs over. A ray is kept if the simulated scan has a return there or the model `adds_returns`, u < `keep`, and the
    /// model's range is finite and positive; its reflectance is held to 0–1. What a model that adds none says about rays without a
    /// return is ignored.
    pub(crate) fn draw(
        &mut self,
        image: &RangeImage,
        outputs: &Outputs<'_>,
        seed: u64,
        adds_returns: bool,
    ) -> Result<(), SampleError> {
        let (range_m, reflectance) = (outputs.of(tensor::RANGE)?, outputs.of(tensor::REFLECTANCE)?);
        let probability = outputs.of(tensor::KEEP)?;
        self.ray_drop.sample(seed, image, probability, &mut self.keep);
        self.range_m.clear();
        self.range_m.extend_from_slice(range_m);
        self.reflectance.clear();
        self.reflectance.extend(reflectance.iter().map(|r| r.clamp(0.0, 1.0)));
        let (mut nan, mut rays) = (0u32, 0u32);
        let said = range_m.iter().zip(reflectance).zip(probability);
        for ((keep, &simulated_m), ((&range_m, &reflectance), &probability)) in
            self.keep.iter_mut().zip(image.range_m()).zip(said)
        {
            let counts = adds_returns || simulated_m > 0.0;
            let is_nan = range_m.is_nan() || reflectance.is_nan() || probability.is_nan();
            // Fewer rays than 2³²; a checked addition would keep the loop from being vectorised.
            rays = rays.wrapping_add(u32::from(counts));
            nan = nan.wrapping_add(u32::from(counts && is_nan));
            *keep &= counts && range_m > 0.0 && range_m < f32::INFINITY;
        }
        if nan > 0 { Err(NotANumber { nan: nan as usize, rays: rays as usize }.into()) } else { Ok(()) }
    }

    /// The rays, for reconstruction.
    pub(crate) fn measured(&self) -> Measured<'_> {
        Measured { range_m: &self.range_m, reflectance: &self.reflectance, keep: &self.keep }
    }
}
