//! An unpaired set: real scans, and simulated ones of other places.

use std::path::{Path, PathBuf};

use lidar::{Projector, RangeImage, Sensor};
use rayon::prelude::*;

use super::paired::{SetDigest, check_size};
use super::scan::{self, Scan};
use super::scenes::{self, Scenes};
use super::units::quantile;
use super::{SetError, folder, notice, units};

/// Scans of a sensor, and scans that a simulator makes of streets of its own: distributions can be compared, rays cannot.
#[derive(Clone, Debug)]
pub struct UnpairedSet {
    /// Name of the set: that of the folder of measured scans.
    pub name: String,
    /// The sensor.
    pub sensor: Sensor,
    /// Turns a second.
    pub rotation_hz: f64,
    /// What the simulator says of its own places, in the order of the files' names.
    pub simulated: Vec<LoneScan>,
    /// What the sensor measured, in the order of the files' names.
    pub measured: Vec<LoneScan>,
    /// Names of the simulated scans' scenes.
    pub simulated_scenes: Vec<String>,
    /// Names of the measured scans' scenes.
    pub measured_scenes: Vec<String>,
    /// Whether every simulated scan comes with semantic labels.
    pub has_labels: bool,
    /// What is odd and yet no error, one sentence each.
    pub notes: Vec<String>,
    /// SHA-256 of the sensor and all images.
    pub sha256: String,
}

/// A scan without a twin.
#[derive(Clone, Debug)]
pub struct LoneScan {
    /// File name without its ending.
    pub name: String,
    /// Index into its half's scenes.
    pub scene: usize,
    /// The scan, `[ring, column]`.
    pub image: RangeImage,
    /// Points that lost their pixel to a nearer one.
    pub extra: usize,
}

impl UnpairedSet {
    /// Reads all scans of two folders. Without a `sensor`, `sensor.toml` lies in the folder of measured scans or in the one above.
    /// `scenes.txt` in either folder names its scans' scenes.
    pub fn read(measured: &Path, simulated: &Path, sensor: Option<&Sensor>) -> Result<Self, SetError> {
        let mut notes = Vec::new();
        let sensor_file = sensor_file(measured);
        let sensor = match sensor {
            Some(sensor) => sensor.clone(),
            None => folder::sensor(&sensor_file, &mut notes)?,
        };
        let files = |dir: &Path, expected| -> Result<Vec<(String, PathBuf)>, SetError> {
            Ok(folder::scans(dir, expected)?.into_iter().map(|(name, path)| (name.text, path)).collect())
        };
        let simulated_files = files(simulated, "the folder of simulated scans")?;
        let measured_files = files(measured, "the folder of measured scans")?;
        check_size(simulated_files.len() + measured_files.len(), sensor.pixels())?;
        let simulated_half = read_all(&simulated_files, &sensor, &sensor_file)?;
        let measured_half = read_all(&measured_files, &sensor, &sensor_file)?;
        // Places differ, so one half's median range says of the other only whether metres are meant.
        let typical_m = median_range_m(&simulated_half, &sensor);
        for (half, files, other_m) in
            [(&simulated_half, &simulated_files, None), (&measured_half, &measured_files, typical_m)]
        {
            check_half(half, files, &sensor, other_m)?;
        }
        let has_labels = simulated_half.iter().all(|scan| scan.labelled);
        let mut halves = Vec::new();
        for (label, dir, files, scans) in
            [("sim", simulated, simulated_files, simulated_half), ("measured", measured, measured_files, measured_half)]
        {
            notes.extend(notice::notes(label, scans.iter().map(|scan| &*scan.notices)));
            let mut of_scenes = Vec::new();
            let Scenes { names, of_frame } = scenes::read(&dir.join("scenes.txt"), files.len(), &mut of_scenes)?;
            notes.extend(of_scenes.into_iter().map(|note| format!("{label}: {note}")));
            let lone = |(((name, _), scan), scene): (((String, PathBuf), Scan), usize)| LoneScan {
                name,
                scene,
                image: scan.image,
                extra: scan.lost,
            };
            halves.push((names, files.into_iter().zip(scans).zip(of_frame).map(lone).collect::<Vec<_>>()));
        }
        let mut digest = SetDigest::new(&sensor);
        for (scenes, scans) in &halves {
            digest.count(scans.len());
            for scan in scans {
                digest.scan(&scan.name, &scenes[scan.scene], &scan.image, scan.extra);
            }
        }
        let [(simulated_scenes, simulated), (measured_scenes, measured_scans)] =
            <[_; 2]>::try_from(halves).unwrap_or_else(|_| unreachable!("two halves"));
        Ok(Self {
            name: folder::name_of(measured),
            rotation_hz: f64::from(sensor.rotation_hz()),
            sensor,
            simulated,
            measured: measured_scans,
            simulated_scenes,
            measured_scenes,
            has_labels,
            notes,
            sha256: digest.finish(),
        })
    }
}

/// `sensor.toml` in the folder, or in the one above if there is one.
fn sensor_file(measured: &Path) -> PathBuf {
    let above = measured.join("..").join("sensor.toml");
    let inside = measured.join("sensor.toml");
    if !inside.is_file() && above.is_file() { above } else { inside }
}

fn read_all(files: &[(String, PathBuf)], sensor: &Sensor, sensor_file: &Path) -> Result<Vec<Scan>, SetError> {
    let scans: Vec<Result<Scan, SetError>> = files
        .par_iter()
        .map_init(|| Projector::new(sensor), |projector, (_, path)| scan::read(path, sensor_file, projector))
        .collect();
    scans.into_iter().collect()
}

fn check_half(
    scans: &[Scan],
    files: &[(String, PathBuf)],
    sensor: &Sensor,
    other_m: Option<f32>,
) -> Result<(), SetError> {
    for (scan, (_, path)) in scans.iter().zip(files) {
        if scan.points > 0 {
            units::check_ranges(path, scan, sensor, other_m)?;
        }
        scan::check_returns(path, &scan.image)?;
    }
    scan::check_one_scale(files.iter().zip(scans).map(|((_, path), scan)| (path.as_path(), scan)))
}

/// Median over the scans that are mostly within the sensor's range; `None` if there is none.
fn median_range_m(scans: &[Scan], sensor: &Sensor) -> Option<f32> {
    let sound = scans.iter().filter(|scan| scan.points > 0 && !units::out_of_reach(scan, sensor));
    let mut medians: Vec<f32> = sound.map(|scan| scan.median_range_m).collect();
    (!medians.is_empty()).then(|| quantile(&mut medians, 0.5))
}
