//! A paired set on disk.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use lidar::formats::{self, FormatError, write_atomically};
use lidar::{RangeImage, Sensor};
use thiserror::Error;

use crate::recipe::{Recipe, frames};

/// A set that could not be written.
#[derive(Debug, Error)]
pub enum SetError {
    /// There is something already.
    #[error("{path} exists already; a set is written into a new folder")]
    Exists {
        /// Where the set was to be.
        path: PathBuf,
    },
    /// A folder could not be made, moved or seen.
    #[error("{path}: {source}")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file could not be written.
    #[error(transparent)]
    File(#[from] FormatError),
}

/// Writes a paired set into the new folder `dir`: `sensor.toml`, `scenes.txt` with the scene of each frame, `sim/000000.ply`, … with
/// labels and `measured/000000.ply`, … without. The recipe is not in it: whoever reads the set shall not know.
///
/// The folder is made beside its place and renamed: it is there with everything in it, or not at all.
pub fn write(recipe: &Recipe, dir: &Path) -> Result<(), SetError> {
    let folder = |path: &Path| {
        let path = path.to_path_buf();
        move |source| SetError::Folder { path, source }
    };
    if dir.exists() {
        return Err(SetError::Exists { path: dir.into() });
    }
    let name = dir.file_name().unwrap_or_default().to_string_lossy();
    let beside = dir.with_file_name(format!(".{name}.{}.part", std::process::id()));
    let written = fill(recipe, &beside).and_then(|()| fs::rename(&beside, dir).map_err(folder(dir)));
    if written.is_err() {
        // The error that matters is the first one; the part may not even be there.
        let _ = fs::remove_dir_all(&beside);
    }
    written
}

fn fill(recipe: &Recipe, dir: &Path) -> Result<(), SetError> {
    let halves = ["sim", "measured"].map(|half| dir.join(half));
    for half in &halves {
        fs::create_dir_all(half).map_err(|source| SetError::Folder { path: half.clone(), source })?;
    }
    write_atomically(&dir.join("sensor.toml"), recipe.sensor.to_toml().as_bytes())?;
    let frames = frames(recipe);
    let scenes: Vec<String> = frames.iter().map(|frame| format!("street-{:02}", frame.scene)).collect();
    write_atomically(&dir.join("scenes.txt"), (scenes.join("\n") + "\n").as_bytes())?;
    for (number, frame) in frames.iter().enumerate() {
        let [simulated, measured] = halves.each_ref().map(|half| half.join(format!("{number:06}.ply")));
        write_scan(&simulated, &recipe.sensor, &frame.simulated, true)?;
        write_scan(&measured, &recipe.sensor, &frame.measured, false)?;
    }
    Ok(())
}

fn write_scan(path: &Path, sensor: &Sensor, image: &RangeImage, labelled: bool) -> Result<(), FormatError> {
    let mut cloud = image.to_cloud(sensor);
    if !labelled {
        cloud.label = None;
    }
    formats::write(path, &cloud)
}
