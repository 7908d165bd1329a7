//! A paired set: simulated and measured scans of the same poses.

use std::path::Path;

use lidar::{Projector, RangeImage, Sensor};
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::scan::{self, Scan};
use super::scenes::{self, Scenes};
use super::{MAX_SET_PIXELS, SetError, folder, notice, twins, units};
use crate::data::scans::hex;

/// Scans of a simulator and of the sensor that it models, frame by frame at the same pose of the same scene.
#[derive(Clone, Debug)]
pub struct PairedSet {
    /// Name of the set: that of its folder.
    pub name: String,
    /// The sensor, as its maker describes it.
    pub sensor: Sensor,
    /// Turns a second.
    pub rotation_hz: f64,
    /// The frames, in the order of their names. There is at least one.
    pub frames: Vec<Frame>,
    /// Names of the scenes; frames of one scene are not independent. Fewer than [`MIN_SCENES`](super::MIN_SCENES) limit what can be claimed.
    pub scenes: Vec<String>,
    /// Whether every simulated scan comes with semantic labels.
    pub has_labels: bool,
    /// What is odd and yet no error, one sentence each.
    pub notes: Vec<String>,
    /// SHA-256 of the sensor, the scenes and all images: the same for the same scans in whatever file format.
    pub sha256: String,
}

/// Two scans of one pose.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The file name that the two scans share, without its ending.
    pub name: String,
    /// Index into [`PairedSet::scenes`].
    pub scene: usize,
    /// What the simulator says, `[ring, column]`.
    pub simulated: RangeImage,
    /// What the sensor measured, `[ring, column]`.
    pub measured: RangeImage,
    /// Measured points that lost their pixel to a nearer one: second returns.
    pub measured_extra: usize,
}

impl PairedSet {
    /// Reads `dir/sensor.toml`, `dir/sim/`, `dir/measured/` and, if it is there, `dir/scenes.txt`.
    ///
    /// Frames are read in parallel, each thread holding one frame's clouds; the result does not depend on it.
    pub fn read(dir: &Path) -> Result<Self, SetError> {
        if !dir.is_dir() {
            return Err(SetError::Missing { path: dir.into(), expected: "the folder of a paired set" });
        }
        let mut notes = Vec::new();
        let sensor_file = dir.join("sensor.toml");
        let sensor = folder::sensor(&sensor_file, &mut notes)?;
        let files = pairs(dir)?;
        check_size(files.len(), 2 * sensor.pixels())?;
        let Scenes { names: scenes, of_frame } = scenes::read(&dir.join("scenes.txt"), files.len(), &mut notes)?;
        let twins: Vec<Result<(Scan, Scan), SetError>> = files
            .par_iter()
            .map_init(
                || Projector::new(&sensor),
                |projector, (_, simulated, measured)| {
                    let simulated = (simulated.as_path(), scan::read(simulated, &sensor_file, projector)?);
                    let measured = (measured.as_path(), scan::read(measured, &sensor_file, projector)?);
                    check_twins(&simulated, &measured, &sensor)?;
                    Ok((simulated.1, measured.1))
                },
            )
            .collect();
        // The first frame's error, not that of the quickest thread.
        let twins = twins.into_iter().collect::<Result<Vec<_>, _>>()?;
        scan::check_one_scale(files.iter().zip(&twins).map(|((_, path, _), (scan, _))| (path.as_path(), scan)))?;
        scan::check_one_scale(files.iter().zip(&twins).map(|((_, _, path), (_, scan))| (path.as_path(), scan)))?;
        notes.extend(notice::notes("sim", twins.iter().map(|(scan, _)| &*scan.notices)));
        notes.extend(notice::notes("measured", twins.iter().map(|(_, scan)| &*scan.notices)));
        let labelled = twins.iter().filter(|(simulated, _)| simulated.labelled).count();
        if (1..twins.len()).contains(&labelled) {
            notes.push(format!("sim: {labelled} of {} scans have labels: none are used", twins.len()));
        }
        let frames =
            files.iter().zip(twins).zip(of_frame).map(|(((name, _, _), (simulated, measured)), scene)| Frame {
                name: name.clone(),
                scene,
                simulated: simulated.image,
                measured: measured.image,
                measured_extra: measured.lost,
            });
        let frames: Vec<Frame> = frames.collect();
        twins::check(&frames, &|i| files[i].2.clone())?;
        Ok(Self::assemble(folder::name_of(dir), sensor, scenes, frames, labelled == files.len(), notes))
    }

    /// A set of frames that are in memory already, checked as those of files are. Labels count as there if any pixel has a class.
    pub fn from_frames(name: &str, sensor: Sensor, scenes: Vec<String>, frames: Vec<Frame>) -> Result<Self, SetError> {
        if frames.is_empty() {
            return Err(SetError::NoScans { folder: name.into() });
        }
        check_size(frames.len(), 2 * sensor.pixels())?;
        let size = (sensor.rings().len(), sensor.columns());
        let file = |i: usize| Path::new(name).join("measured").join(&frames[i].name);
        for (i, frame) in frames.iter().enumerate() {
            let fail =
                |field, found, expected| Err(SetError::Frame { frame: frame.name.clone(), field, found, expected });
            for (field, image) in [("simulated", &frame.simulated), ("measured", &frame.measured)] {
                let found = (image.rings(), image.columns());
                if found != size {
                    let text = |(rings, columns)| format!("{rings} rings × {columns} columns");
                    return fail(field, text(found), text(size));
                }
            }
            if frame.scene >= scenes.len() {
                return fail("scene", frame.scene.to_string(), format!("an index into {} scenes", scenes.len()));
            }
            scan::check_returns(&Path::new(name).join("sim").join(&frame.name), &frame.simulated)?;
            scan::check_returns(&file(i), &frame.measured)?;
        }
        twins::check(&frames, &file)?;
        let mut notes = Vec::new();
        scenes::note_few(scenes.len(), &mut notes);
        let has_labels = frames.iter().any(|frame| frame.simulated.class().iter().any(|class| *class > 0));
        Ok(Self::assemble(name.into(), sensor, scenes, frames, has_labels, notes))
    }

    fn assemble(
        name: String,
        sensor: Sensor,
        scenes: Vec<String>,
        frames: Vec<Frame>,
        has_labels: bool,
        notes: Vec<String>,
    ) -> Self {
        let mut digest = SetDigest::new(&sensor);
        for frame in &frames {
            digest.scan(&frame.name, &scenes[frame.scene], &frame.simulated, 0);
            digest.scan(&frame.name, &scenes[frame.scene], &frame.measured, frame.measured_extra);
        }
        let rotation_hz = f64::from(sensor.rotation_hz());
        Self { name, sensor, rotation_hz, frames, scenes, has_labels, notes, sha256: digest.finish() }
    }
}

/// Frame name, simulated file and measured file of each frame.
fn pairs(dir: &Path) -> Result<Vec<(String, std::path::PathBuf, std::path::PathBuf)>, SetError> {
    let simulated = folder::scans(&dir.join("sim"), "the folder of simulated scans")?;
    let mut measured = folder::scans(&dir.join("measured"), "the folder of measured scans")?;
    let (mut pairs, mut lonely) = (Vec::with_capacity(simulated.len()), Vec::new());
    for (name, file) in simulated {
        match measured.remove(&name) {
            Some(twin) => pairs.push((name.text, file, twin)),
            None => lonely.push(name.text),
        }
    }
    if lonely.is_empty() && measured.is_empty() {
        return Ok(pairs);
    }
    let measured = measured.into_keys().map(|name| name.text).collect();
    Err(SetError::NoPartner { set: dir.into(), simulated: lonely, measured })
}

/// Refuses a set whose images would not fit into memory, before any is made.
pub(super) fn check_size(frames: usize, pixels: usize) -> Result<(), SetError> {
    match frames.checked_mul(pixels) {
        Some(all) if all <= MAX_SET_PIXELS => Ok(()),
        _ => Err(SetError::TooLarge { frames, pixels, limit: MAX_SET_PIXELS }),
    }
}

/// Units and emptiness, which two scans of one place tell better than one.
fn check_twins(simulated: &(&Path, Scan), measured: &(&Path, Scan), sensor: &Sensor) -> Result<(), SetError> {
    // An empty scan has no unit.
    for (path, scan) in [simulated, measured] {
        if scan.points == 0 {
            scan::check_returns(path, &scan.image)?;
        }
    }
    let sound = |scan: &Scan| (!units::out_of_reach(scan, sensor)).then_some(scan.median_range_m);
    units::check_ranges(
        simulated.0,
        &simulated.1,
        sensor,
        sound(&measured.1).filter(|_| sound(&simulated.1).is_none()),
    )?;
    units::check_ranges(measured.0, &measured.1, sensor, sound(&simulated.1))?;
    scan::check_returns(simulated.0, &simulated.1.image)?;
    scan::check_returns(measured.0, &measured.1.image)
}

/// SHA-256 of what a set says, whatever files it says it in.
pub(super) struct SetDigest(Sha256);

impl SetDigest {
    pub(super) fn new(sensor: &Sensor) -> Self {
        Self(Sha256::new_with_prefix(sensor.to_toml()))
    }

    /// Length of the list that follows.
    pub(super) fn count(&mut self, scans: usize) {
        self.0.update((scans as u64).to_le_bytes());
    }

    pub(super) fn scan(&mut self, name: &str, scene: &str, image: &RangeImage, extra: usize) {
        for text in [name, scene] {
            self.0.update((text.len() as u64).to_le_bytes());
            self.0.update(text);
        }
        self.0.update((extra as u64).to_le_bytes());
        for channel in [image.range_m(), image.reflectance()] {
            self.0.update(channel.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>());
        }
        self.0.update(image.class());
    }

    pub(super) fn finish(self) -> String {
        hex(&self.0.finalize())
    }
}
