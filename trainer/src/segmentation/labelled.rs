//! Labelled scans, from folders of files of any format.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use lidar::formats::{self, Limits};
use lidar::{Projector, RangeImage, Sensor};

use crate::data::scans::scan_files;

/// The scans of a folder, in the order of their files' names, on a sensor's grid.
///
/// By elevation: scans that were projected before they were published have lost the order that tells their rings.
pub fn labelled_scans(folder: &Path, sensor: &Sensor) -> Result<Vec<RangeImage>> {
    let mut projector = Projector::new(sensor).by_elevation();
    let read = |file: &PathBuf| -> Result<RangeImage> {
        let cloud = formats::read(file, &Limits::default())?;
        ensure!(cloud.label.is_some(), "it has no labels");
        Ok(projector.project(&cloud)?.image)
    };
    let files = scan_files(folder)?;
    let scans = files.iter().map(read);
    scans.zip(&files).map(|(scan, file)| scan.with_context(|| format!("scan {}", file.display()))).collect()
}
