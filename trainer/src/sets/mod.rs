//! Sets of scans for the closed loop: what a simulator says and what the sensor measured, read, checked and projected.
//!
//! A set that exists can be trusted: its scans are of the sensor that it names, in metres and from 0 to 1, right-handed, and twins
//! show the same place. Whatever is wrong with the files is a [`SetError`] that says what to change; what is odd but no error is
//! among the set's notes.
//!
//! ```text
//! SET/sensor.toml           name, elevation_deg = [one a ring], columns, range_min_m, range_max_m, rotation_hz (10 if left out)
//! SET/sim/000000.ply …      x, y, z (m, x ahead, y left, z up), intensity (0–1), ring, label (SemanticKITTI id; may be absent)
//! SET/measured/000000.ply … x, y, z, intensity, ring: what the sensor reported at the same pose of the same scene
//! SET/scenes.txt            one scene name a line, in the order of the frames' names; may be absent
//! ```
//!
//! Frames pair by file name, whatever their formats.

mod columns;
mod error;
mod folder;
mod notice;
mod paired;
mod rays;
mod scan;
mod scenes;
#[cfg(test)]
mod tests;
mod twins;
mod units;
mod unpaired;

pub use error::{Defect, DefectKind, SetError};
pub use paired::{Frame, PairedSet};
pub use unpaired::{LoneScan, UnpairedSet};

/// Scenes that the loop needs: one to discover on, one to tune on, one to confirm on.
pub const MIN_SCENES: usize = 3;

/// Most pixels of all images of a set: 2.4 GB at 9 bytes each.
pub const MAX_SET_PIXELS: usize = 1 << 28;
