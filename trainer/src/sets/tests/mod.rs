//! Every way in which a set can be wrong is told by file and field; real effects, however strong, are not.

#![allow(clippy::unwrap_used, reason = "a test that panics is a test that fails")]

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use lidar::formats::{Format, encode};
use lidar::{PointCloud, RangeImage, Sensor};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, Scene, cast};
use tempfile::TempDir;

use super::*;

mod accepted;
mod files;
mod scans;
mod twins;
mod unpaired;

const FRAMES: usize = 6;

fn elevations_deg() -> Vec<f64> {
    (0..16).map(|ring| 2.0 - 1.6 * f64::from(ring)).collect()
}

fn sensor_of(elevations_deg: Vec<f64>, columns: usize) -> Sensor {
    Sensor::from_elevations_deg("small", elevations_deg, columns, (1.0, 100.0), 10.0).unwrap()
}

/// Three streets of two poses each, seen by a sensor.
fn cast_by(sensor: &Sensor) -> Vec<PointCloud> {
    cast_from(sensor, Pose::default(), Motion::default())
}

/// The same from poses that lean as `lean` does.
fn cast_from(sensor: &Sensor, lean: Pose, motion: Motion) -> Vec<PointCloud> {
    static STREETS: OnceLock<Vec<Scene>> = OnceLock::new();
    let streets = STREETS.get_or_init(|| (0..3).map(|seed| street(seed, &StreetConfig::default())).collect());
    let seen = |frame: usize| {
        let pose = Pose { position_m: [4.0 * (frame % 2) as f32, 0.0, 1.73], ..lean };
        cast(&streets[frame / 2], sensor, &pose, &motion).cloud
    };
    (0..FRAMES).map(seen).collect()
}

/// A set that is right, as clouds.
#[derive(Clone)]
struct Halves {
    simulated: Vec<PointCloud>,
    measured: Vec<PointCloud>,
}

fn sound() -> Halves {
    static CASTS: OnceLock<Vec<PointCloud>> = OnceLock::new();
    let simulated = CASTS.get_or_init(|| cast_by(&sensor_of(elevations_deg(), 256))).clone();
    let measured = simulated.iter().map(|c| PointCloud { label: None, extra: Vec::new(), ..c.clone() }).collect();
    Halves { simulated, measured }
}

impl Halves {
    fn write(&self) -> TempDir {
        let dir = TempDir::new().unwrap();
        for (half, clouds) in [("sim", &self.simulated), ("measured", &self.measured)] {
            fs::create_dir(dir.path().join(half)).unwrap();
            for (frame, cloud) in clouds.iter().enumerate() {
                put(&dir.path().join(format!("{half}/{frame:06}.ply")), cloud);
            }
        }
        fs::write(dir.path().join("sensor.toml"), sensor_of(elevations_deg(), 256).to_toml()).unwrap();
        let scenes: Vec<String> = (0..self.simulated.len()).map(|frame| format!("street-{}", frame / 2)).collect();
        fs::write(dir.path().join("scenes.txt"), scenes.join("\n")).unwrap();
        dir
    }

    fn read(&self) -> Result<PairedSet, SetError> {
        PairedSet::read(self.write().path())
    }

    fn each_measured(mut self, change: impl FnMut(&mut PointCloud)) -> Self {
        self.measured.iter_mut().for_each(change);
        self
    }

    fn each(self, mut change: impl FnMut(&mut PointCloud)) -> Self {
        let mut halves = self.each_measured(&mut change);
        halves.simulated.iter_mut().for_each(change);
        halves
    }
}

fn put(path: &Path, cloud: &PointCloud) {
    let format = Format::from_path(path).unwrap();
    fs::write(path, encode(format, cloud).unwrap()).unwrap();
}

fn scale(cloud: &mut PointCloud, factor: f32) {
    for axis in [&mut cloud.x, &mut cloud.y, &mut cloud.z] {
        for v in axis.iter_mut() {
            *v *= factor;
        }
    }
}

/// Ranges as they were times and plus something.
fn stretch(cloud: &mut PointCloud, mut range_m: impl FnMut(f32) -> f32) {
    for i in 0..cloud.len() {
        let was_m = cloud.range_m(i);
        let by = range_m(was_m) / was_m;
        (cloud.x[i], cloud.y[i], cloud.z[i]) = (cloud.x[i] * by, cloud.y[i] * by, cloud.z[i] * by);
    }
}

fn drop_points(cloud: &mut PointCloud, mut keep: impl FnMut(usize) -> bool) {
    let kept: Vec<u32> = (0..cloud.len()).filter(|i| keep(*i)).map(|i| i as u32).collect();
    *cloud = cloud.select(&kept);
}

fn turn(cloud: &mut PointCloud, left_deg: f32) {
    let (sin, cos) = left_deg.to_radians().sin_cos();
    for i in 0..cloud.len() {
        let (x, y) = (cloud.x[i], cloud.y[i]);
        (cloud.x[i], cloud.y[i]) = (x * cos - y * sin, x * sin + y * cos);
    }
}

/// Asserts that the set is refused for this reason, in a message with all these words.
#[track_caller]
fn refused(read: Result<PairedSet, SetError>, kind: Option<DefectKind>, words: &[&str]) {
    let error = match read {
        Ok(set) => panic!("read without an error; notes: {:?}", set.notes),
        Err(error) => error,
    };
    let text = error.to_string();
    for word in words {
        assert!(text.contains(word), "`{word}` is not in: {text}");
    }
    let found = match error {
        SetError::Defect(defect) => Some(defect.kind),
        _ => None,
    };
    assert_eq!(found, kind, "{text}");
}

#[track_caller]
fn accepted(halves: &Halves) -> PairedSet {
    halves.read().unwrap_or_else(|error| panic!("a false alarm: {error}"))
}

/// The points in another order, so that it says nothing about rings.
fn shuffle(cloud: &mut PointCloud) {
    let len = cloud.len();
    let order: Vec<u32> = (0..len).map(|i| (i * 7919 % len) as u32).collect();
    *cloud = cloud.select(&order);
}
