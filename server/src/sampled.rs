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

/// A model that gave no number for a ray that has a return.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("the model gave NaN for {rays} of the scan's {returns} returns")]
pub struct NotANumber {
    /// Rays with a NaN in range, reflectance or keep.
    pub rays: usize,
    /// Rays that have a return in the simulated scan.
    pub returns: usize,
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
    /// Takes the outputs over. A ray is kept if the simulated scan has a return there, u < `keep`, and the model's range is finite and
    /// positive; its reflectance is held to 0–1. What the model says about rays without a return is ignored.
    pub(crate) fn draw(&mut self, image: &RangeImage, outputs: &Outputs<'_>, seed: u64) -> Result<(), SampleError> {
        let (range_m, reflectance) = (outputs.of(tensor::RANGE)?, outputs.of(tensor::REFLECTANCE)?);
        let probability = outputs.of(tensor::KEEP)?;
        ray_drop::sample(seed, image.columns(), probability, &mut self.scratch, &mut self.keep);
        self.range_m.clear();
        self.range_m.extend_from_slice(range_m);
        self.reflectance.clear();
        self.reflectance.extend(reflectance.iter().map(|r| r.clamp(0.0, 1.0)));
        let (mut rays, mut returns) = (0, 0);
        for (i, simulated_m) in image.range_m().iter().enumerate() {
            let has_return = *simulated_m > 0.0;
            let nan = range_m[i].is_nan() || reflectance[i].is_nan() || probability[i].is_nan();
            returns += usize::from(has_return);
            rays += usize::from(has_return && nan);
            self.keep[i] &= has_return && range_m[i] > 0.0 && range_m[i].is_finite();
        }
        if rays > 0 { Err(NotANumber { rays, returns }.into()) } else { Ok(()) }
    }

    /// The rays, for reconstruction.
    pub(crate) fn measured(&self) -> Measured<'_> {
        Measured { range_m: &self.range_m, reflectance: &self.reflectance, keep: &self.keep }
    }
}
