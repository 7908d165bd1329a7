//! A network that tells what each return of a scan belongs to: its features are what scans are compared by (`crate::realness`).
//!
//! A small relative of `RangeNet++` (Milioto et al., "`RangeNet++`: Fast and accurate lidar semantic segmentation", IROS 2019). It is
//! trained on labelled real scans and on made-up streets, so that it looks at simulated and real scans with the same eyes.

pub mod classes;
pub mod config;
pub mod darknet;
pub mod downstream;
pub mod input;
pub mod labelled;
pub mod sampler;
pub mod score;
pub mod streets;
pub mod train;
pub mod weights;

pub use classes::{CLASSES, NAMES};
pub use config::SegmentationConfig;
pub use darknet::{Darknet, DarknetConfig};
pub use weights::Segmentation;
