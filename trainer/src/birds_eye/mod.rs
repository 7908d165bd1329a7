//! Scans seen from above: a `CycleGAN` that makes simulated ones look real, and a vehicle detector that says what that is worth.
//!
//! After Saleh et al., "Domain adaptation for vehicle detection from bird's eye view lidar point cloud data" (ICCV workshops 2019). What is
//! seen from above does not lead back to points: it is training data for detectors, nothing that the service could return.

pub mod config;
mod cycle_gan;
pub mod dataset;
pub mod detection;
mod detector;
mod footprint;
mod sampler;
pub mod scan;
mod score;
pub mod training;
pub mod translator;
mod vehicles;

pub use config::BirdsEyeConfig;
pub use footprint::Footprint;
