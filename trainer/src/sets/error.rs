//! What can be wrong with a set of scans.

use std::path::PathBuf;

use lidar::formats::FormatError;
use lidar::projection::ProjectionError;
use thiserror::Error;

/// Most file names that a message lists.
const MAX_LISTED: usize = 5;

/// A set that cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SetError {
    /// A file or folder of the set is not there.
    #[error("{}: missing; expected {expected}", path.display())]
    Missing {
        /// Where it should be.
        path: PathBuf,
        /// What it is.
        expected: &'static str,
    },
    /// The operating system refuses.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Its reason.
        source: std::io::Error,
    },
    /// No sensor can be made of the sensor's file.
    #[error("{}: {message}", path.display())]
    Sensor {
        /// The sensor's file.
        path: PathBuf,
        /// Field and bounds.
        message: String,
    },
    /// A file that is no point cloud; the message names it.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A cloud that cannot be projected.
    #[error("{}: {source}", path.display())]
    Projection {
        /// The scan.
        path: PathBuf,
        /// Why.
        source: ProjectionError,
    },
    /// A folder without scans.
    #[error("{}: no scan; expected point cloud files (ply, bin, pcd, las, laz, npy, npz)", folder.display())]
    NoScans {
        /// The folder.
        folder: PathBuf,
    },
    /// Two files of one frame in one folder.
    #[error("{} and {} are one frame's scan twice; remove one", first.display(), second.display())]
    SameName {
        /// One of them.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// Frames without a twin.
    #[error(
        "{}: frames without a partner: {}; the two scans of a frame have one file name",
        set.display(),
        [("sim", "measured", simulated), ("measured", "sim", measured)].iter().filter(|(_, _, names)| !names.is_empty())
            .map(|(here, there, names)| format!("{} of {here}/ not in {there}/ ({})", names.len(), listed(names)))
            .collect::<Vec<_>>().join(", ")
    )]
    NoPartner {
        /// The set.
        set: PathBuf,
        /// Frames that only `sim/` has.
        simulated: Vec<String>,
        /// Frames that only `measured/` has.
        measured: Vec<String>,
    },
    /// The list of scenes does not fit the frames.
    #[error("{}: {found}; expected {expected}", path.display())]
    Scenes {
        /// The list.
        path: PathBuf,
        /// What it has.
        found: String,
        /// What it should have.
        expected: String,
    },
    /// More pixels than a set may have.
    #[error(
        "{frames} frames of {pixels} pixels each are more than {limit} pixels; take fewer frames or fewer `columns`"
    )]
    TooLarge {
        /// Frames of the set.
        frames: usize,
        /// Pixels of a frame, both halves together.
        pixels: usize,
        /// Most pixels of a set.
        limit: usize,
    },
    /// A frame handed over in memory that does not fit the set.
    #[error("frame `{frame}`: {field} is {found}, expected {expected}")]
    Frame {
        /// The frame's name.
        frame: String,
        /// Field of [`Frame`](super::Frame).
        field: &'static str,
        /// What it is.
        found: String,
        /// What it should be.
        expected: String,
    },
    /// The scans say something else than the set's format.
    #[error(transparent)]
    Defect(#[from] Box<Defect>),
}

/// Scans that can be read but are not what the set's format says.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{}: {field}: {found}; expected {expected}. {fix}", file.display())]
pub struct Defect {
    /// What is wrong, for programs.
    pub kind: DefectKind,
    /// The file, or the set where all its scans are alike.
    pub file: PathBuf,
    /// Field of the file.
    pub field: &'static str,
    /// What is there.
    pub found: String,
    /// What should be there.
    pub expected: String,
    /// What most likely puts it right.
    pub fix: String,
}

/// The kinds of [`Defect`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum DefectKind {
    /// All rays dropped.
    NoReturns,
    /// NaN or infinite numbers.
    NotFinite,
    /// A ring that the sensor does not have.
    RingOutOfRange,
    /// Scans of a sensor with more or fewer rings.
    RingCount,
    /// Scans of a sensor with more or fewer columns.
    ColumnCount,
    /// Points that do not lie on the sensor's rays.
    OffRays,
    /// Radians for degrees.
    AngleUnit,
    /// Intensities that are not from 0 to 1.
    IntensityUnit,
    /// Ranges that are not in metres.
    RangeUnit,
    /// Left and right exchanged.
    LeftHanded,
    /// A frame turned about the vertical axis.
    Turned,
    /// Twins that have hardly a ray in common, or show different places.
    NoOverlap,
}

/// The first names of a list.
fn listed(names: &[String]) -> String {
    let more = if names.len() > MAX_LISTED { ", …" } else { "" };
    names[..names.len().min(MAX_LISTED)].join(", ") + more
}
