//! Paired sets of scans with a known defect hidden in the measured half: the data on which the closed loop is judged.
//!
//! A frame is cast twice in one made-up street: along the rays that the sensor's description promises, which gives the simulated
//! half, and along the rays that the defective sensor really sends, reported as if they were the promised ones, which gives the
//! measured half. Everything is computed a ray at a time in plain numbers. The library of effects that the loop fits shares no line
//! with this crate, which depends on neither tensors nor the trainer, so an error in one of the two cannot hide in the other.
//!
//! A measured ray comes about in this order, whatever the order of the defects in the recipe: *geometry* decides what it meets, then
//! errors of *range* are added (each computed from the true range), *reflectance* is weakened and amplified, weak *returns* are
//! lost and false ones added, and at last come the sensor's own noise, saturation, drop, quantisation and range limits.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use hidden::{Defect, Range, Recipe, frames, small_sensor};
//!
//! let bias = Defect::from(Range::RangeOffset { offset_m: 0.05 });
//! let recipe = Recipe { scenes: 2, frames_per_scene: 1, ..Recipe::new(7, small_sensor(7), vec![bias]) };
//! let set = frames(&recipe);
//! assert_eq!(set.len(), 2);
//! let both = set[0].simulated.range_m().iter().zip(set[0].measured.range_m()).filter(|(s, m)| **s > 0.0 && **m > 0.0);
//! let errors: Vec<f32> = both.map(|(s, m)| m - s).collect();
//! let mean_m = errors.iter().sum::<f32>() / errors.len() as f32;
//! assert!((mean_m - 0.05).abs() < 0.002);
//! # Ok(())
//! # }
//! ```

mod defect;
mod dice;
mod drive;
mod geometry;
mod measure;
mod range;
mod recipe;
mod reflectance;
mod returns;
mod sensors;
mod set;
mod sweep;
mod unknown;

pub use defect::{Channel, Defect, LIBRARY, UNKNOWN, typical};
pub use geometry::Geometry;
pub use range::Range;
pub use recipe::{HiddenFrame, Noise, Recipe, frame, frames};
pub use reflectance::Reflectance;
pub use returns::Returns;
pub use sensors::{even_sensor, small_sensor};
pub use set::{SetError, write};
pub use unknown::Unknown;
