//! What a comparison hands over: the model with the effects in its graph, its card, and the report.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use lidar::label::CLASS_NAMES;
use lidar::ray_drop::Bursts;
use proto::card::{Card, Dataset, SCHEMA};
use sha2::{Digest, Sha256};

use super::{Finding, UnpairedReport};
use crate::closed_loop::model::{SensorModel, Term};
use crate::closed_loop::{declared, export, folder};
use crate::data::scans::hex;
use crate::effects::{NOISE_CHANNELS, NoiseFloor};
use crate::sets::UnpairedSet;

/// Share of outliers that the noise floor of scans without twins is given: none can be counted.
const OUTLIERS: f64 = 1e-3;

/// A finished comparison.
#[derive(Debug)]
pub struct UnpairedDelivery {
    /// What was found.
    pub report: UnpairedReport,
    /// The model's card.
    pub card: Card,
    /// The model's file.
    pub onnx: Vec<u8>,
}

impl UnpairedDelivery {
    /// Exports the model of what was found.
    pub fn new(set: &UnpairedSet, finding: Finding, seed: u64) -> Result<Self> {
        let model = model(set, &finding);
        let card = card(set, &finding, &model);
        let onnx = export::to_onnx(&model, None, &card)?;
        let report = UnpairedReport {
            set: set.name.clone(),
            sensor: set.sensor.name.clone(),
            after: hex(&Sha256::digest(&onnx)),
            scans: [set.simulated.len(), set.measured.len()],
            seed,
            finding,
        };
        Ok(Self { report, card, onnx })
    }

    /// Fills a folder, or replaces an earlier calibration; see [`folder::check`].
    pub fn write(&self, to: &Path) -> Result<()> {
        let [model, card, json, html] = folder::FILES;
        let about = crate::export::to_markdown(&self.card);
        let (report_json, report_html) = (self.report.json()?, self.report.html());
        let files = [
            (model, self.onnx.as_slice()),
            (card, about.as_bytes()),
            (json, report_json.as_bytes()),
            (html, report_html.as_bytes()),
        ];
        folder::replace(to, &files)
    }
}

/// The noise floor that the measured scans show, and what was found.
fn model(set: &UnpairedSet, finding: &Finding) -> SensorModel {
    let rings = set.sensor.rings().len();
    let noise = &finding.noise;
    let numbers = [
        noise.range_sigma_m.max(1e-3),
        noise.reflectance_sigma.max(1e-3),
        noise.drop.clamp(1e-4, 0.9),
        OUTLIERS,
        OUTLIERS,
    ];
    let floor = SensorModel { terms: vec![Term::new(Arc::new(NoiseFloor), rings).at(&numbers)] };
    floor.with(&finding.effects().into_iter().map(|found| found.term.clone()).collect::<Vec<_>>())
}

fn card(set: &UnpairedSet, finding: &Finding, model: &SensorModel) -> Card {
    let found = finding.effects();
    let names: Vec<&str> = found.iter().map(|found| found.term.name()).collect();
    let mut notes = format!(
        "Calibrated from an ideal sensor on real scans without simulated twins. Effects that were found: {}.",
        if names.is_empty() { "none".into() } else { names.join(", ") }
    );
    for caveat in &finding.caveats {
        notes = format!("{notes} {caveat}.");
    }
    Card {
        schema: SCHEMA,
        name: export::servable_name(&set.name),
        summary: format!(
            "{}, calibrated on {} scans of {} without twins",
            set.sensor.name,
            set.measured.len(),
            set.name
        ),
        licence: export::NO_LICENCE.into(),
        column_multiple: set.sensor.columns(),
        noise_channels: NOISE_CHANNELS,
        adds_returns: false,
        drop_bursts: Bursts::default(),
        classes: CLASS_NAMES.iter().map(ToString::to_string).collect(),
        effects: declared::write(model, &found),
        trained_on: vec![Dataset {
            name: format!("{}: measured scans, and simulated ones of other places", set.name),
            licence: export::NO_LICENCE.into(),
            scans: set.measured.len() + set.simulated.len(),
            sha256: set.sha256.clone(),
        }],
        scores: vec![],
        notes,
        sensor: set.sensor.clone(),
    }
}
