//! What a surface is made of.

use serde::{Deserialize, Serialize};

/// A surface: what it is, and how much of the laser's light it sends back.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// `SemanticKITTI` label: semantic id in the lower 16 bits (see [`lidar::label`]), instance in the upper 16 (0 = none).
    pub label: u32,
    /// Share of the light that is reflected, 0–1: of a diffuse surface in all directions, of a retroreflector back to the sensor.
    pub reflectance: f32,
    /// Sends the light back to where it came from: traffic signs, number plates, reflectors.
    pub retro: bool,
}

impl Material {
    /// A surface that scatters light in all directions.
    pub const fn diffuse(label: u32, reflectance: f32) -> Self {
        Self { label, reflectance, retro: false }
    }

    /// A surface that sends light back to where it came from.
    pub const fn retro(label: u32, reflectance: f32) -> Self {
        Self { label, reflectance, retro: true }
    }
}
