//! What a calibration hands over: the model with the effects in its graph, its card, and the report.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::Result;
use proto::card::{Card, Score};
use sha2::{Digest, Sha256};

use super::base::Base;
use super::calibrate::Calibration;
use super::data::Batch;
use super::metrics::{Confirmation, METRICS};
use super::model::{SensorModel, Term};
use super::report::{Identity, Report, Unseen};
use super::{export, folder};
use crate::data::scans::hex;
use crate::sets::{MIN_SCENES, PairedSet};

/// What stands for the digest of a model that has no file: an ideal sensor.
const IDEAL: &str = "ideal";

/// A finished calibration.
#[derive(Debug)]
pub struct Delivery {
    /// What was found and what it is worth.
    pub report: Report,
    /// The model's card.
    pub card: Card,
    /// The model's file.
    pub onnx: Vec<u8>,
}

impl Delivery {
    /// Judges a calibration on its confirm frames, and exports its model.
    pub fn new(set: &PairedSet, base: &Base, calibration: Calibration, seed: u64) -> Result<Self> {
        let Calibration { split, confirm, mut outcome } = calibration;
        outcome.caveats.extend(not_served(&outcome.after));
        let frames = [split.discover.len(), split.tune.len(), split.confirm.len()];
        let identity = Identity {
            set: set.name.clone(),
            sensor: set.sensor.name.clone(),
            before: base.file.as_ref().map_or_else(|| IDEAL.to_owned(), |file| file.sha256.clone()),
            // Known only when the scores, which are part of the file, are.
            after: String::new(),
            frames,
            unseen: unseen(set, &split.discover, &split.confirm),
            seed,
        };
        let mut report = Report::new(outcome, identity, &confirm.iter().collect::<Vec<&Batch>>());
        let card = export::card(set, base, &report.outcome, scores(&report.confirmation, frames[2]));
        let onnx = export::to_onnx(&report.outcome.after, base.network.as_ref(), &card)?;
        report.identity.after = hex(&Sha256::digest(&onnx));
        Ok(Self { report, card, onnx })
    }

    /// Fills a folder, or replaces an earlier calibration; see [`folder::check`].
    pub fn write(&self, to: &Path) -> Result<()> {
        let [model, card, json, html] = folder::FILES;
        let about = crate::export::to_markdown(&self.card);
        let (report_json, report_html) = (self.report.json()?, self.report.html()?);
        folder::replace(
            to,
            &[
                (model, &self.onnx),
                (card, about.as_bytes()),
                (json, report_json.as_bytes()),
                (html, report_html.as_bytes()),
            ],
        )
    }
}

/// What a served model cannot do that the model of a loop does: it does not know which scan of a recording it is given.
fn not_served(model: &SensorModel) -> Option<String> {
    let by_frame = model.effects().iter().filter(|term| term.effect.about().covariates.contains(&"frame"));
    let names: Vec<&str> = by_frame.map(Term::name).collect();
    (!names.is_empty()).then(|| {
        format!(
            "{} depends on the number of the frame, which a served model is not told: it answers as for frame 0, so the errors quoted \
             here are of the loop's model alone",
            names.join(", ")
        )
    })
}

/// How new the confirm frames are.
fn unseen(set: &PairedSet, discover: &[usize], confirm: &[usize]) -> Unseen {
    let scenes: BTreeSet<usize> = set.frames.iter().map(|frame| frame.scene).collect();
    if discover.iter().any(|frame| confirm.contains(frame)) {
        Unseen::Nothing
    } else if scenes.len() < MIN_SCENES {
        Unseen::Frames
    } else {
        Unseen::Scenes
    }
}

/// The metrics of the model after, the model before in place of the pass-through.
fn scores(confirmation: &Confirmation, frames: usize) -> Vec<Score> {
    let score = |metric: &super::metrics::Metric| {
        let unit = METRICS.iter().find(|(name, _)| *name == metric.name).map_or("", |(_, unit)| *unit);
        let (model, pass_through) = (metric.after.value, metric.before.value);
        let finite = model.is_finite() && pass_through.is_finite();
        finite.then(|| Score { metric: metric.name.into(), unit: unit.into(), model, pass_through, scans: frames })
    };
    confirmation.metrics.iter().filter_map(score).collect()
}
