//! Point cloud files: from bytes to a [`PointCloud`] and back, for every format the project reads.
//!
//! Every reader takes bytes from strangers: it checks each count against the bytes that are there and against [`Limits`] before it
//! allocates, and a bad file is a [`FormatError`] that names the field and its offset. Points that make no sense (NaN, zero range)
//! are kept; projection counts and drops them.

mod carla;
mod error;
mod input;
mod io;
mod kitti;
mod labels;
mod las;
mod meaning;
mod npy;
mod npz;
mod number;
mod nuscenes;
mod pcd;
mod ply;
mod point_cloud2;
mod record;
mod text;
mod zip;

use std::path::Path;

use crate::PointCloud;
use crate::label::CarlaTags;

pub use error::FormatError;
pub use io::{read, write, write_atomically};
pub use labels::{decode_labels, encode_labels};
pub use point_cloud2::RosMessage;

/// A point cloud file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// Four float32 a point: x, y, z, intensity from 0 to 1. KITTI's `.bin`, and the bytes of CARLA's `ray_cast` lidar.
    Kitti,
    /// Five float32 a point: x, y, z, intensity from 0 to 255, ring. nuScenes' `.pcd.bin`.
    NuScenes,
    /// 24 bytes a point: float32 x, y, z, cosine of the incidence angle, uint32 object, uint32 tag. CARLA's `ray_cast_semantic`.
    CarlaSemantic,
    /// Stanford PLY: ASCII or binary of either byte order; written little-endian.
    Ply,
    /// ASPRS LAS 1.0–1.4; written as 1.4.
    Las,
    /// LAS compressed by `LASzip`.
    Laz,
    /// Point Cloud Library: ASCII, binary, or LZF-compressed; written binary.
    Pcd,
    /// One `NumPy` array, structured or plain; written structured.
    Npy,
    /// Several `NumPy` arrays in a ZIP archive.
    Npz,
    /// ROS 2's `sensor_msgs/msg/PointCloud2`, serialised as CDR.
    PointCloud2,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 10] = [
        Self::Kitti,
        Self::NuScenes,
        Self::CarlaSemantic,
        Self::Ply,
        Self::Las,
        Self::Laz,
        Self::Pcd,
        Self::Npy,
        Self::Npz,
        Self::PointCloud2,
    ];

    /// The format that a file's name tells, whatever its case; `None` where it tells none.
    ///
    /// The longest ending wins: `.pcd.bin` is nuScenes, `.semantic.bin` is CARLA's semantic lidar, any other `.bin` is KITTI.
    pub fn from_path(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        let fits = |format: &Self| name.strip_suffix(format.extension()).is_some_and(|stem| stem.ends_with('.'));
        Self::ALL.into_iter().filter(fits).max_by_key(|format| format.extension().len())
    }

    /// The name that people and command lines use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Kitti => "kitti",
            Self::NuScenes => "nuscenes",
            Self::CarlaSemantic => "carla-semantic",
            Self::Ply => "ply",
            Self::Las => "las",
            Self::Laz => "laz",
            Self::Pcd => "pcd",
            Self::Npy => "npy",
            Self::Npz => "npz",
            Self::PointCloud2 => "point-cloud2",
        }
    }

    /// The format of this [`name`](Self::name).
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }

    /// The file name's ending, without its first dot. [`from_path`](Self::from_path) reads it back.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Kitti => "bin",
            Self::NuScenes => "pcd.bin",
            Self::CarlaSemantic => "semantic.bin",
            Self::Ply => "ply",
            Self::Las => "las",
            Self::Laz => "laz",
            Self::Pcd => "pcd",
            Self::Npy => "npy",
            Self::Npz => "npz",
            Self::PointCloud2 => "cdr",
        }
    }
}

/// What a reader accepts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Most points of one cloud. A file that holds or declares more is refused before anything is allocated.
    pub max_points: usize,
    /// Most bytes that a file may unpack to, which a compressed one does not show.
    pub max_unpacked_bytes: usize,
    /// CARLA's table of tags: files do not say which one they use.
    pub carla_tags: CarlaTags,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_points: 4_000_000, max_unpacked_bytes: 512 << 20, carla_tags: CarlaTags::Since0914 }
    }
}

/// Reads a cloud. The format is the caller's word: bytes of another one are an error or, for formats without a header, nonsense.
pub fn decode(format: Format, bytes: &[u8], limits: &Limits) -> Result<PointCloud, FormatError> {
    let cloud = match format {
        Format::Kitti => kitti::decode(bytes, limits),
        Format::NuScenes => nuscenes::decode(bytes, limits),
        Format::CarlaSemantic => carla::decode(bytes, limits),
        Format::Ply => ply::decode(bytes, limits),
        Format::Las | Format::Laz => las::decode(bytes, limits),
        Format::Pcd => pcd::decode(bytes, limits),
        Format::Npy => npy::decode(bytes, limits),
        Format::Npz => npz::decode(bytes, limits),
        Format::PointCloud2 => point_cloud2::decode(bytes, limits),
    }?;
    cloud.check()?;
    Ok(cloud)
}

/// Writes a cloud with every field that the format can carry.
///
/// KITTI carries x, y, z and intensity; nuScenes the ring besides; CARLA's semantic lidar labels instead of intensity. All others carry
/// every field: PLY and ROS messages turn 64-bit integers into doubles, LAS rounds coordinates to 0.1 mm.
pub fn encode(format: Format, cloud: &PointCloud) -> Result<Vec<u8>, FormatError> {
    cloud.check()?;
    match format {
        Format::Kitti => Ok(kitti::encode(cloud)),
        Format::NuScenes => Ok(nuscenes::encode(cloud)),
        Format::CarlaSemantic => Ok(carla::encode(cloud)),
        Format::Ply => Ok(ply::encode(cloud)),
        Format::Las => las::encode(cloud, false),
        Format::Laz => las::encode(cloud, true),
        Format::Pcd => Ok(pcd::encode(cloud)),
        Format::Npy => npy::encode(cloud),
        Format::Npz => npz::encode(cloud),
        Format::PointCloud2 => point_cloud2::encode(cloud),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_is_known_by_its_extension_and_its_name() {
        for format in Format::ALL {
            let path = format!("scans.d/000000.{}", format.extension());
            assert_eq!(Format::from_path(Path::new(&path)), Some(format), "{path}");
            assert_eq!(Format::from_path(Path::new(&path.to_uppercase())), Some(format), "{path}");
            assert_eq!(Format::from_name(format.name()), Some(format));
        }
    }

    #[test]
    fn a_name_that_tells_nothing_has_no_format() {
        for path in ["", "ply", "scan.txt", "scan", "scans.ply/", "a.xply"] {
            let known = Format::from_path(Path::new(path));
            assert!(known.is_none() || path.ends_with('/'), "{path}: {known:?}");
        }
    }
}
