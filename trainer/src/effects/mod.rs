//! The library of sensor effects: one file each.
//!
//! An effect turns an [`Image`] — the surfaces that a simulation says each ray hits, and the distribution of what the sensor reports of
//! them — into the image of a sensor that has the effect. It is written once, in Burn tensors: the closed loop fits it by automatic
//! differentiation, and the exporter captures the same forward pass into `model.onnx`.

mod aim;
pub mod covariate;
pub mod draw;
pub mod evidence;
#[cfg(test)]
mod exported;
pub mod extra;
#[cfg(test)]
mod extremes;
#[cfg(test)]
mod forms;
pub mod image;
mod incidence;
mod neighbours;
pub mod parameter;
pub mod passage;
pub mod rays;
mod resample;
pub mod smooth_table;
pub mod surface;
#[cfg(test)]
pub(crate) mod trial;
#[cfg(test)]
mod truth;

mod azimuth_offset_per_ring;
mod blocked_sector;
mod blooming;
mod drift;
mod elevation_offset;
mod elevation_offset_per_ring;
mod encoder_eccentricity;
mod fog;
mod incidence_falloff;
mod incidence_stretch;
mod mixed_pixels;
mod mount_height;
mod mount_pitch;
mod mount_roll;
mod mount_yaw;
mod noise_floor;
mod precipitation;
mod quantisation;
mod random_returns;
mod range_limits;
mod range_noise;
mod range_offset;
mod range_scale;
mod range_walk;
mod reflectance_falloff;
mod reflectance_gain;
mod ring_gain;
mod rolling_shutter;
mod saturation;
mod specular;
mod weak_return_drop;

use std::fmt::Debug;
use std::sync::Arc;

pub use covariate::Covariate;
pub use draw::{Drawn, NOISE_CHANNELS, normal};
pub use evidence::Evidence;
pub use extra::{Extra, Place};
pub use image::{Image, Settled, Simulated};
pub use noise_floor::NoiseFloor;
pub use parameter::{Extent, Kind, Parameter, Values};
pub use rays::{Bend, Rays};
pub use smooth_table::{SmoothTable, Target};
pub use surface::Surface;

/// Share of what a fit finds of moved rays that the planes of an image leave open, as hidden sets show.
const OPEN_OF_SURFACES: f64 = 0.01;

/// The same of an effect over the angle of incidence.
const OPEN_OF_INCIDENCE: f64 = 0.02;

/// A sensor effect.
pub trait Effect: Debug + Send + Sync {
    /// What it is.
    fn about(&self) -> About;

    /// Its parameters, in the order in which [`forward`](Self::forward) finds their values.
    fn parameters(&self) -> Vec<Parameter>;

    /// The image of a sensor that has it. Tensors `[batch, ring, column]`.
    fn forward(&self, values: &Values, image: Image) -> Image;

    /// Numbers that are part of what it is and not fitted, by their names: the knots of a table.
    fn constants(&self) -> Vec<(String, f64)> {
        vec![]
    }

    /// Values from which a fit should start on these data, where the starts of [`parameters`](Self::parameters) would lead it astray: one
    /// or several lists, each of all the parameters' numbers in their order. The best after the fit counts.
    fn starts(&self, _evidence: &Evidence) -> Vec<Vec<f64>> {
        vec![]
    }

    /// Effects of the library that, with a part of its numbers' size, make the same reports beside a weaker one of it: no data tell which
    /// it is. `stderr` are the standard errors of `values`.
    fn ties(&self, _values: &[f64], _stderr: &[f64]) -> &'static [&'static str] {
        &[]
    }

    /// Standard deviation of each of its numbers `values` that the sensor's grid, and what an image cannot show, leave beside chance.
    fn left_open(&self, values: &[f64], _rays: &Rays) -> Vec<f64> {
        let about = self.about();
        let share = match about.channel {
            Channel::Geometry => OPEN_OF_SURFACES,
            _ if about.covariates.contains(&"incidence") => OPEN_OF_INCIDENCE,
            _ => 0.0,
        };
        values.iter().map(|value| share * value.abs()).collect()
    }

    /// The same as its numbers `values` say, in words that people are used to: name with unit, value.
    fn derived(&self, _values: &[f64]) -> Vec<(&'static str, f64)> {
        vec![]
    }
}

/// Every effect of the library, for a sensor of `rings` rings.
pub fn library() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(elevation_offset::ElevationOffset),
        Arc::new(elevation_offset_per_ring::ElevationOffsetPerRing),
        Arc::new(azimuth_offset_per_ring::AzimuthOffsetPerRing),
        Arc::new(encoder_eccentricity::EncoderEccentricity),
        Arc::new(mount_roll::MountRoll),
        Arc::new(mount_pitch::MountPitch),
        Arc::new(mount_yaw::MountYaw),
        Arc::new(mount_height::MountHeight),
        Arc::new(rolling_shutter::RollingShutter),
        Arc::new(range_offset::RangeOffset),
        Arc::new(range_offset::RangeOffsetPerRing),
        Arc::new(range_scale::RangeScale),
        Arc::new(range_walk::RangeWalk),
        Arc::new(range_noise::RangeNoise),
        Arc::new(incidence_stretch::IncidenceStretch),
        Arc::new(mixed_pixels::MixedPixels),
        Arc::new(quantisation::Quantisation),
        Arc::new(reflectance_gain::ReflectanceGain),
        Arc::new(ring_gain::RingGain),
        Arc::new(reflectance_falloff::ReflectanceFalloff),
        Arc::new(incidence_falloff::IncidenceFalloff),
        Arc::new(saturation::Saturation),
        Arc::new(weak_return_drop::WeakReturnDrop),
        Arc::new(specular::Specular),
        Arc::new(fog::Fog),
        Arc::new(range_limits::RangeLimits),
        Arc::new(blocked_sector::BlockedSector),
        Arc::new(random_returns::RandomReturns),
        Arc::new(blooming::Blooming),
        Arc::new(precipitation::Precipitation),
        Arc::new(drift::Drift),
    ]
}

/// What an effect is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct About {
    /// Identifier, as in reports.
    pub name: &'static str,
    /// What the sensor does, for a sentence that begins "The sensor …": `{offset_m}` is a parameter's place, and `{higher|lower}` after it
    /// the word for its sign.
    pub does: &'static str,
    /// The channel that it belongs to.
    pub channel: Channel,
    /// Which of the likelihoods it changes.
    pub acts_on: ActsOn,
    /// What it depends on.
    pub covariates: &'static [&'static str],
    /// Its formula.
    pub formula: &'static str,
    /// Where the formula comes from.
    pub source: &'static str,
}

/// The six channels of residual.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// Mean of the range.
    Range,
    /// Spread of the range.
    RangeVariance,
    /// Directions and places of the rays.
    Geometry,
    /// Reflectance.
    Reflectance,
    /// Rays without a return.
    Missing,
    /// Returns without a surface.
    Extra,
}

/// Which likelihoods an effect changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ActsOn {
    /// Range, given a return.
    pub range: bool,
    /// Reflectance, given a return.
    pub reflectance: bool,
    /// Return or no return.
    pub returns: bool,
}

impl ActsOn {
    /// Range alone.
    pub const RANGE: Self = Self { range: true, reflectance: false, returns: false };
    /// Reflectance alone.
    pub const REFLECTANCE: Self = Self { range: false, reflectance: true, returns: false };
    /// Return or no return alone.
    pub const RETURNS: Self = Self { range: false, reflectance: false, returns: true };
    /// All of them.
    pub const ALL: Self = Self { range: true, reflectance: true, returns: true };

    /// Whether there is one that both change.
    pub fn overlaps(self, other: Self) -> bool {
        (self.range && other.range) || (self.reflectance && other.reflectance) || (self.returns && other.returns)
    }

    /// What either acts on.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            range: self.range || other.range,
            reflectance: self.reflectance || other.reflectance,
            returns: self.returns || other.returns,
        }
    }
}
