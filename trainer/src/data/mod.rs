//! Scans to learn from: loaded, filled, cut out.

pub mod holes;
pub mod sample;
pub mod scans;

pub use sample::{Batch, Sampler, Source};
pub use scans::Scans;
