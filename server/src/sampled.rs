//! What the sensor reports of each ray: the model's outputs, checked, with ray drop decided.

use lidar::{Measured, RangeImage, ray_drop};
use proto::card::tensor;
use thiserror::Error;

use crate::generator::{InferenceError, Outputs};

/// Range, reflectance and whether the ray is kept, each `[ring, column]`; keeps its memory from scan to scan.
#[derive(Debug, Default)]
pub(crate) struct Sampled {
    range_m: Vec<f32>,
    reflectance: Vec<f32>,
    keep: Vec<bool>,
    scratch: Vec<f32>,
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
        ray_drop::sample(seed, image.columns(), probability, &mut self.scratch, &mut self.keep);
        self.range_m.clear();
        self.range_m.extend_from_slice(range_m);
        self.reflectance.clear();
        self.reflectance.extend(reflectance.iter().map(|r| r.clamp(0.0, 1.0)));
        let (mut nan, mut rays) = (0, 0);
        for (i, simulated_m) in image.range_m().iter().enumerate() {
            let counts = adds_returns || *simulated_m > 0.0;
            let is_nan = range_m[i].is_nan() || reflectance[i].is_nan() || probability[i].is_nan();
            rays += usize::from(counts);
            nan += usize::from(counts && is_nan);
            self.keep[i] &= counts && range_m[i] > 0.0 && range_m[i].is_finite();
        }
        if nan > 0 { Err(NotANumber { nan, rays }.into()) } else { Ok(()) }
    }

    /// The rays, for reconstruction.
    pub(crate) fn measured(&self) -> Measured<'_> {
        Measured { range_m: &self.range_m, reflectance: &self.reflectance, keep: &self.keep }
    }
}
