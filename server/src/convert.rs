//! Conversion of files: the service's pipeline on a file or on every scan of a folder.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lidar::formats::{Format, Limits};
use proto::{Frame, MediaType};
use sha2::{Digest, Sha256};
use thiserror::Error;

use crate::generator::Chance;
use crate::model::Model;
use crate::pipeline::{FileJob, Pipeline, PipelineError, ScanError};

/// How to convert.
#[derive(Clone, Debug)]
pub struct Conversion {
    /// The model.
    pub model: Arc<Model>,
    /// What is left to chance. The seed is that of a single file; each file of a folder gets [its own](seed_of_file) from it.
    pub chance: Chance,
    /// Frame of the scans; `None` leaves it to the format: CARLA's for CARLA's semantic lidar, ours for all others.
    pub frame: Option<Frame>,
    /// What the readers accept.
    pub limits: Limits,
    /// Threads within an operator of the model.
    pub threads: usize,
}

/// Files that were not converted.
#[derive(Debug, Error)]
pub enum ConvertError {
    /// The model does not load.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// A file or folder cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A file's name tells no format.
    #[error("{}: the name tells no point cloud format", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// A file's content does not get through.
    #[error("{}: {source}", path.display())]
    Scan {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ScanError,
    },
    /// The folder has no scan.
    #[error("{}: no file in this folder has the name of a point cloud", path.display())]
    NoScans {
        /// The folder.
        path: PathBuf,
    },
    /// The results would take the place of the scans.
    #[error("{}: results would be written over the scans they are made of", path.display())]
    SamePlace {
        /// The file or folder.
        path: PathBuf,
    },
    /// Some files of a folder failed; the others are converted.
    #[error("{} of {files} files failed:\n{}", failed.len(), failed.join("\n"))]
    Some {
        /// Files in all.
        files: usize,
        /// What is wrong with each file that failed.
        failed: Vec<String>,
    },
}

/// Seed of a file within a folder: the first eight bytes, little-endian, of SHA-256(seed as eight bytes little-endian ‖ SHA-256 of the
/// file's bytes).
///
/// Scans of one drive would share one pattern of dropped rays if they shared a seed. The content decides, not the name or the
/// order, so that a file converts to the same bytes wherever and whenever it is converted.
pub fn seed_of_file(seed: u64, bytes: &[u8]) -> u64 {
    let digest = Sha256::new().chain_update(seed.to_le_bytes()).chain_update(Sha256::digest(bytes)).finalize();
    digest.iter().take(8).rev().fold(0, |seed, byte| seed << 8 | u64::from(*byte))
}

/// Converts a file, or every scan under a folder into the same place under another. Returns the number of files converted.
///
/// A single file is converted with the seed as it is: the same bytes as the service gives with `?seed=`. The names tell the formats;
/// a file's answer may have another one than the file. Results are written beside their place and renamed.
pub fn convert(conversion: &Conversion, from: &Path, to: &Path) -> Result<usize, ConvertError> {
    let mut pipeline = Pipeline::new(&conversion.model, conversion.threads)?;
    if !from.is_dir() {
        let to = if to.is_dir() { to.join(from.file_name().unwrap_or_default()) } else { to.into() };
        refuse_same_place(from, &to)?;
        let line = convert_file(&mut pipeline, conversion, (from, &to), false)?;
        tracing::info!("{line}");
        return Ok(1);
    }
    refuse_same_place(from, to)?;
    let scans = scans_under(from)?;
    if scans.is_empty() {
        return Err(ConvertError::NoScans { path: from.into() });
    }
    let mut failed = Vec::new();
    for (i, scan) in scans.iter().enumerate() {
        let to = to.join(scan.strip_prefix(from).unwrap_or(scan));
        match convert_file(&mut pipeline, conversion, (scan, &to), true) {
            Ok(line) => tracing::info!("[{}/{}] {line}", i + 1, scans.len()),
            Err(error) => {
                tracing::error!("[{}/{}] {error}", i + 1, scans.len());
                failed.push(error.to_string());
            }
        }
    }
    if failed.is_empty() { Ok(scans.len()) } else { Err(ConvertError::Some { files: scans.len(), failed }) }
}

/// Converts one file and says what was done.
fn convert_file(
    pipeline: &mut Pipeline,
    conversion: &Conversion,
    (from, to): (&Path, &Path),
    in_folder: bool,
) -> Result<String, ConvertError> {
    let format_of =
        |path: &Path| Format::from_path(path).ok_or_else(|| ConvertError::UnknownFormat { path: path.into() });
    let format = format_of(from)?;
    format_of(to)?;
    let seed = if in_folder {
        let bytes = fs::read(from).map_err(|source| ConvertError::Io { path: from.into(), source })?;
        seed_of_file(conversion.chance.seed, &bytes)
    } else {
        conversion.chance.seed
    };
    let file = FileJob {
        frame: conversion.frame.unwrap_or_else(|| MediaType::of_format(format).frame),
        chance: Chance { seed, ..conversion.chance },
        limits: conversion.limits,
    };
    let folder = to.parent().unwrap_or(Path::new(""));
    fs::create_dir_all(folder).map_err(|source| ConvertError::Io { path: folder.into(), source })?;
    let fit = pipeline.run_file(from, to, file).map_err(|source| ConvertError::Scan { path: from.into(), source })?;
    if let Some(warning) = &fit.warning {
        tracing::warn!("{}: {warning}", from.display());
    }
    let (points, kept, added) = (fit.report.points_in, fit.kept, fit.added);
    Ok(format!("{} → {}: {points} points, {kept} kept, {added} added, seed {seed}", from.display(), to.display()))
}

/// Files under a folder whose name tells a format, sorted.
fn scans_under(folder: &Path) -> Result<Vec<PathBuf>, ConvertError> {
    let mut folders = vec![folder.to_path_buf()];
    let mut scans = Vec::new();
    while let Some(folder) = folders.pop() {
        let fail = |source| ConvertError::Io { path: folder.clone(), source };
        for entry in fs::read_dir(&folder).map_err(fail)? {
            let entry = entry.map_err(fail)?;
            // A link to a folder is not followed: it may lead back up.
            if entry.file_type().map_err(fail)?.is_dir() {
                folders.push(entry.path());
            } else if Format::from_path(&entry.path()).is_some() {
                scans.push(entry.path());
            }
        }
    }
    scans.sort();
    Ok(scans)
}

fn refuse_same_place(from: &Path, to: &Path) -> Result<(), ConvertError> {
    let real = |path: &Path| path.canonicalize().ok();
    if real(from).is_some_and(|from| real(to) == Some(from)) {
        return Err(ConvertError::SamePlace { path: from.into() });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_files_seed_depends_on_the_given_seed_and_on_its_bytes() {
        // python3: int.from_bytes(sha256((7).to_bytes(8,"little") + sha256(b"scan").digest()).digest()[:8], "little")
        assert_eq!(seed_of_file(7, b"scan"), SEED_7_SCAN);
        assert_ne!(seed_of_file(8, b"scan"), SEED_7_SCAN);
        assert_ne!(seed_of_file(7, b"scans"), SEED_7_SCAN);
    }

    const SEED_7_SCAN: u64 = 1_263_767_056_813_247_972;
}
