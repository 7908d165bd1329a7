//! How like real scans a set of scans is, and how true to the simulation that it was made from. No network: whoever has features of
//! scans hands them in.
//!
//! Two metrics of one name stay two metrics here: every [`Metric`] carries its definition. Scores of a probability, ray by ray, are in
//! [`lidar::metrics`].

pub mod bev;
pub mod bootstrap;
pub mod chamfer;
pub mod cls2r;
pub mod density_aware;
pub mod divergence;
pub mod faithful;
pub mod farthest;
pub mod frechet;
pub mod kernel;
pub mod matching;
pub mod metric;
pub mod nearest;
pub mod points;
pub mod pyramid;
pub mod ray_loss;
pub mod reflectance;
pub mod set;
pub mod sliced;
pub mod voxels;

pub use bootstrap::{Draws, Resampled};
pub use metric::{Floor, Metric, Score};
pub use set::{Features, Set};
