//! Reading meshes: OBJ, `glTF` and `CityJSON`.

mod city_object;
mod cityjson;
mod gltf_mesh;
mod names;
mod obj;
mod polygon;

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::mesh::{Mesh, TriangleError};

/// Files longer than this are refused unread.
pub const MAX_FILE_BYTES: u64 = 1 << 30;

/// A mesh file that cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The name's ending says nothing that we read.
    #[error("`{0}`: expected a file that ends in .obj, .gltf, .glb or .json (CityJSON)")]
    UnknownKind(PathBuf),
    /// The file cannot be read.
    #[error("`{path}`: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file is larger than anything we would load.
    #[error("`{path}` has {bytes} bytes, expected at most {MAX_FILE_BYTES}")]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
    },
    /// The file as a whole is not what its name says.
    #[error("`{path}` is no valid {format}: {problem}")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The format.
        format: &'static str,
        /// What is wrong.
        problem: String,
    },
    /// One object of the file is wrong.
    #[error("`{path}`, {object}: {problem}")]
    Object {
        /// The file.
        path: PathBuf,
        /// The object, as the file calls it.
        object: String,
        /// What is wrong.
        problem: String,
    },
    /// The file has no triangle.
    #[error("`{0}` has no triangle")]
    Empty(PathBuf),
}

/// What a file leaves open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadOptions {
    /// The axis that points up in an OBJ file, which cannot say so itself; Y as Blender and most others write it.
    pub obj_up: Up,
    /// Length of the file's unit in metres. `CityJSON` is always in metres.
    pub unit_m: f32,
}

/// The axis that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// y up, z ahead, x left: becomes z up, x ahead, y left.
    Y,
    /// z up already: taken as it is.
    Z,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self { obj_up: Up::Y, unit_m: 1.0 }
    }
}

/// Loads a mesh, by the ending of its name: `.obj`, `.gltf`, `.glb`, or `.json` (`CityJSON`).
///
/// Labels come from names: of materials, groups, nodes and meshes (`car`, `road`, `tree`, …; unlabelled if none fits), or from
/// `CityJSON`'s object types and surface semantics. Reflectances are the luminance of the material's base colour, or typical ones
/// for the label. `glTF`'s y-up frame is turned into ours; a `CityJSON` file is moved so that its middle is at x = y = 0 and its lowest
/// point at z = 0.
pub fn load(path: impl AsRef<Path>) -> Result<Mesh, MeshError> {
    load_with(path, LoadOptions::default())
}

/// [`load`] with what the file leaves open.
pub fn load_with(path: impl AsRef<Path>, options: LoadOptions) -> Result<Mesh, MeshError> {
    let path = path.as_ref();
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let mesh = match ending.as_deref() {
        Some("obj") => obj::load(path, options)?,
        Some("gltf" | "glb") => gltf_mesh::load(path, options)?,
        Some("json") => cityjson::load(path)?,
        _ => return Err(MeshError::UnknownKind(path.into())),
    };
    if mesh.is_empty() { Err(MeshError::Empty(path.into())) } else { Ok(mesh) }
}

/// The file's bytes, if it is not too long.
fn read(path: &Path) -> Result<Vec<u8>, MeshError> {
    let io = |source| MeshError::Io { path: path.into(), source };
    let bytes = std::fs::metadata(path).map_err(io)?.len();
    if bytes > MAX_FILE_BYTES {
        return Err(MeshError::TooLarge { path: path.into(), bytes });
    }
    std::fs::read(path).map_err(io)
}

/// An error of one object.
fn object_error(path: &Path, object: impl Into<String>, problem: impl Into<String>) -> MeshError {
    MeshError::Object { path: path.into(), object: object.into(), problem: problem.into() }
}

/// A triangle error of one object.
fn of_object(path: &Path, object: &str) -> impl Fn(TriangleError) -> MeshError {
    move |error| object_error(path, object, error.to_string())
}
