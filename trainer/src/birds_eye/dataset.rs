//! What detectors of one's own learn from: scans from above as files.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use lidar::birds_eye::{BirdsEye, CHANNELS, Grid};
use lidar::formats::write_atomically;
use npyz::WriterBuilder;
use serde::Serialize;

use super::config::BirdsEyeConfig;
use super::footprint::Footprint;
use super::scan::{Scan, Turn};
use super::training::translator_for;
use super::vehicles::Vehicles;
use crate::data::scans::scan_files;

/// Names of an array's channels.
const CHANNEL_NAMES: [&str; CHANNELS] = ["height", "reflectance", "density"];

/// What an array shows.
#[derive(Serialize)]
struct Described {
    grid: Grid,
    channels: [&'static str; CHANNELS],
    /// As [`Vehicles::clear`].
    vehicles: Vec<Footprint>,
    /// As [`Vehicles::unclear`].
    unclear: Vec<Footprint>,
}

/// Writes every scan of a folder from above, as it is or as a run's translation makes it: `NAME.npy`, float32 `[3, row, column]`, `NAME.json`,
/// the vehicles that its labels show, and `NAME.png` to look at. Returns the arrays' paths.
pub fn write(config: &BirdsEyeConfig, scans: &Path, through: Option<&Path>, out: &Path) -> Result<Vec<PathBuf>> {
    let translator = through.map(|run| translator_for(run, config)).transpose()?;
    let (files, scans) = (scan_files(scans)?, Scan::read_all(scans, config.projector()?)?);
    let target = |file: &PathBuf| out.join(file.with_extension("npy").file_name().unwrap_or_default());
    let mut targets = BTreeSet::new();
    for file in &files {
        let target = target(file);
        ensure!(!files.contains(&target), "{} is a scan itself: choose another folder to write to", target.display());
        ensure!(targets.insert(target), "scan {}: another has the same name", file.display());
    }
    std::fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    let write = |((file, scan), seed): ((&PathBuf, &Scan), u64)| -> Result<PathBuf> {
        let (seen, vehicles) = scan.seen(&config.grid, Turn::default());
        let image = translator.as_ref().map_or_else(|| seen.clone(), |translator| translator.translate(&seen, seed));
        let target = target(file);
        write_atomically(&target, &array(&image)?)?;
        let Vehicles { clear: vehicles, unclear } = vehicles;
        let described = Described { grid: config.grid, channels: CHANNEL_NAMES, vehicles, unclear };
        write_atomically(&target.with_extension("json"), &serde_json::to_vec_pretty(&described)?)?;
        write_atomically(&target.with_extension("png"), &drawn(&config.grid, &image, &described.vehicles)?)?;
        Ok(target)
    };
    files.iter().zip(&scans).zip(0..).map(write).collect()
}

fn array(image: &BirdsEye) -> Result<Vec<u8>> {
    let mut bytes = vec![];
    let shape = [CHANNELS, image.cells, image.cells].map(|n| n as u64);
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(&mut bytes).begin_nd()?;
    writer.extend(image.values.iter().copied())?;
    writer.finish()?;
    Ok(bytes)
}

fn drawn(grid: &Grid, image: &BirdsEye, vehicles: &[Footprint]) -> Result<Vec<u8>> {
    let outlines: Vec<_> = vehicles.iter().map(|vehicle| vehicle.outline(grid)).collect();
    Ok(lidar::picture::from_above(&[(image, &[][..], "from above"), (image, &outlines, "vehicles by its labels")])?)
}
