//! A street and a ray caster: labelled simulated scans where no simulator is at hand.

pub mod cast;
pub mod material;
pub mod mesh;
pub mod mesh_file;
pub mod pose;
pub mod scene;
mod shape;
pub mod street;

pub use cast::{Cast, cast};
pub use material::Material;
pub use mesh::Mesh;
pub use pose::{Motion, Pose};
pub use scene::{Hit, Scene};
