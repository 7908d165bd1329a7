//! What a person and other programs read of a loop: `report.json`, `report.html` and a few sentences.

pub(super) mod html;
pub(super) mod json;
pub(super) mod numbers;
mod picture;
pub(super) mod plot;
mod section;
mod sentence;
pub(super) mod words;

use std::path::Path;

use lidar::RangeImage;
use lidar::formats::write_atomically;
use serde::Serialize;

use super::data::Batch;
use super::metrics::{Confirmation, confirm};
use super::outcome::Outcome;
use super::predicted::{Predicted, numbers as host};
use super::screen::{EffectCurve, effect_curve};

/// What a report is of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Identity {
    /// Name of the set.
    pub set: String,
    /// Name of its sensor.
    pub sensor: String,
    /// SHA-256 of the model before.
    pub before: String,
    /// SHA-256 of the model after.
    pub after: String,
    /// Numbers of frames that were for discovering, tuning, confirming.
    pub frames: [usize; 3],
    /// How new the confirm frames were.
    pub unseen: Unseen,
    /// Seed of the run.
    pub seed: u64,
}

/// How new the frames were that the errors are of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Unseen {
    /// Of scenes that nothing was fitted on.
    Scenes,
    /// New, but of scenes of which others were fitted.
    Frames,
    /// Fitted on.
    Nothing,
}

/// What the loop came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The model has what the sensor does.
    NothingMissing,
    /// Effects of the library were added.
    EffectsAdded,
    /// Something is missing that the library has no name for.
    UnexplainedOnly,
}

/// Everything that a report shows.
#[derive(Clone, Debug)]
pub struct Report {
    /// What it is of.
    pub identity: Identity,
    /// What the loop found.
    pub outcome: Outcome,
    /// What that was worth on the confirm frames.
    pub confirmation: Confirmation,
    /// A curve an effect, on the confirm frames.
    pub curves: Vec<EffectCurve>,
    /// A confirm frame.
    pub view: Option<View>,
}

/// One frame as the simulation, the sensor and the model after have it.
#[derive(Clone, Debug)]
pub struct View {
    /// Number of the frame.
    pub frame: usize,
    /// What the simulation says.
    pub simulated: RangeImage,
    /// What the sensor measured.
    pub measured: RangeImage,
    /// What the model after says: medians, of rays that are reported more often than not.
    pub predicted: RangeImage,
}

impl Report {
    /// Judges an outcome on the confirm frames.
    ///
    /// # Panics
    /// If there is no confirm frame.
    pub fn new(outcome: Outcome, identity: Identity, confirm_frames: &[&Batch]) -> Self {
        let seed = identity.seed;
        let confirmation = confirm(&outcome.before, &outcome.after, confirm_frames, seed);
        let curve = |name: &str| {
            let curve = effect_curve(&outcome.after, name, &outcome.screening_before, confirm_frames, seed);
            curve.map(|curve| EffectCurve { effect: name.into(), ..curve })
        };
        let curves = outcome.effects.iter().filter_map(|found| curve(found.term.name())).collect();
        let view = confirm_frames.first().map(|batch| View::new(&outcome, batch));
        Self { identity, outcome, confirmation, curves, view }
    }

    /// What the loop came to.
    pub fn verdict(&self) -> Verdict {
        match (self.outcome.effects.is_empty(), self.outcome.unexplained.is_empty()) {
            (false, _) => Verdict::EffectsAdded,
            (true, false) => Verdict::UnexplainedOnly,
            (true, true) => Verdict::NothingMissing,
        }
    }

    /// The answer in sentences, a paragraph a line.
    pub fn words(&self) -> String {
        words::summary(self)
    }

    /// `report.json`.
    pub fn json(&self) -> anyhow::Result<String> {
        json::text(&json::Document::new(self))
    }

    /// `report.html`: one file that needs no other.
    pub fn html(&self) -> anyhow::Result<String> {
        html::page(self)
    }

    /// Writes both into a folder, each whole or not at all.
    pub fn write(&self, folder: &Path) -> anyhow::Result<()> {
        write_atomically(&folder.join("report.json"), self.json()?.as_bytes())?;
        write_atomically(&folder.join("report.html"), self.html()?.as_bytes())?;
        Ok(())
    }
}

impl View {
    fn new(outcome: &Outcome, batch: &Batch) -> Self {
        let after = Predicted::new(&outcome.after, batch);
        let (rays, columns) = (after.rays(), after.size[1]);
        let surface = &batch.image.surface;
        let dims = batch.observed.range_m.dims();
        let first = |x: Vec<f32>| x[..rays].to_vec();
        let image = |range_m: Vec<f32>, reflectance: Vec<f32>| {
            RangeImage::from_channels(columns, range_m, reflectance, vec![0; rays])
        };
        let likely = (0..rays).map(|i| if after.reported[i] > 0.5 { after.range_m[i] } else { 0.0 }).collect();
        Self {
            frame: batch.frames[0],
            simulated: image(first(host(&surface.range_m, dims)), first(host(&surface.reflectance, dims))),
            predicted: image(likely, first(after.median_reflectance)),
            measured: image(first(after.measured_range_m), first(after.measured_reflectance)),
        }
    }
}

#[cfg(test)]
mod tests;
