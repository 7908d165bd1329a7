//! What a lidar scan is: point cloud, sensor, range image, ray drop, file formats. No network, no machine learning.

mod azimuth;
pub mod birds_eye;
pub mod cloud;
pub mod formats;
pub mod label;
pub mod metrics;
pub mod picture;
pub mod projection;
pub mod range_image;
pub mod ray_drop;
mod rings;
pub mod sensor;
mod whole;

pub use cloud::PointCloud;
pub use projection::{EmptyRays, Measured, Projection, Projector};
pub use range_image::RangeImage;
pub use rings::RingSource;
pub use sensor::{Ring, Sensor};
