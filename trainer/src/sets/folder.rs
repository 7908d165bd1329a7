//! The files of a set: its sensor and the scans of its folders.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use lidar::Sensor;
use lidar::formats::Format;

use super::SetError;

/// Most bytes of a text file of a set; a line for each of a million frames.
const MAX_TEXT_BYTES: u64 = 1 << 26;

/// Turns a second where the sensor's file does not say: the rate of nearly every spinning lidar.
const DEFAULT_ROTATION_HZ: f64 = 10.0;

/// The scans of a folder by frame name (the file's name without its format's ending), in order: numbers by value, names by alphabet.
pub(super) fn scans(folder: &Path, expected: &'static str) -> Result<BTreeMap<FrameName, PathBuf>, SetError> {
    let io = |source| SetError::Io { path: folder.into(), source };
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return Err(SetError::Missing { path: folder.into(), expected });
        }
        entries => entries.map_err(io)?,
    };
    let mut scans = BTreeMap::new();
    for entry in entries {
        let path = entry.map_err(io)?.path();
        let Some((name, format)) = path.file_name().and_then(|n| n.to_str()).zip(Format::from_path(&path)) else {
            continue;
        };
        // Names that begin with a dot are half-written files and the droppings of file managers.
        if name.starts_with('.') || !path.is_file() {
            continue;
        }
        let stem = &name[..name.len() - format.extension().len() - 1];
        match scans.entry(FrameName::new(stem)) {
            Entry::Vacant(place) => {
                place.insert(path);
            }
            Entry::Occupied(there) => {
                let (first, second) = (there.get().clone().min(path.clone()), there.get().clone().max(path));
                return Err(SetError::SameName { first, second });
            }
        }
    }
    if scans.is_empty() {
        return Err(SetError::NoScans { folder: folder.into() });
    }
    Ok(scans)
}

/// A frame's name; frame 2 comes before frame 10.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct FrameName {
    number: Option<u64>,
    pub(super) text: String,
}

impl FrameName {
    fn new(text: &str) -> Self {
        Self { number: text.parse().ok(), text: text.into() }
    }
}

/// Reads a sensor's file. A turn rate that is left out is 10 Hz, a name that is left out is that of the folder; notes say so.
pub(super) fn sensor(path: &Path, notes: &mut Vec<String>) -> Result<Sensor, SetError> {
    const EXPECTED: &str =
        "the sensor's columns, range_min_m, range_max_m, rotation_hz and elevation_deg = [one a ring], in TOML";
    let text = text(path)?.ok_or_else(|| SetError::Missing { path: path.into(), expected: EXPECTED })?;
    let failed = |message| SetError::Sensor { path: path.into(), message };
    let mut table: toml::Table = text.parse().map_err(|e: toml::de::Error| failed(e.to_string()))?;
    if !table.contains_key("rotation_hz") {
        table.insert("rotation_hz".into(), DEFAULT_ROTATION_HZ.into());
        notes.push(format!("sensor.toml has no rotation_hz: taken as {DEFAULT_ROTATION_HZ} Hz"));
    }
    if !table.contains_key("name") {
        let folder = path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
        table.insert("name".into(), folder.into());
    }
    table.try_into().map_err(|e: toml::de::Error| failed(e.to_string().trim().replace('\n', " ")))
}

/// The text of a file; `None` where there is no file.
pub(super) fn text(path: &Path) -> Result<Option<String>, SetError> {
    let io = |source| SetError::Io { path: path.into(), source };
    let mut text = String::new();
    match File::open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        file => file.map_err(io)?.take(MAX_TEXT_BYTES).read_to_string(&mut text).map_err(io)?,
    };
    Ok(Some(text))
}

/// A folder's or file's own name.
pub(super) fn name_of(path: &Path) -> String {
    let whole = path.canonicalize().unwrap_or_else(|_| path.into());
    whole.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
