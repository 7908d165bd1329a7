//! Exported models, by their files alone.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use lidar::formats::{self, Limits};
use lidar::{Projector, RangeImage};
use proto::card::{Card, METADATA_KEY};

use crate::closed_loop::network::Network;
use crate::data::sample::Sample;
use crate::data::scans::{cut_columns, scan_files};
use crate::evaluate::{Scores, made_simulated, scores};
use crate::generator::Answer;
use crate::translation::Domain;

/// The card in a model's file.
pub fn card(onnx: &[u8]) -> Result<Card> {
    let session = runtime::open(&runtime::environment()?, onnx, 1)?;
    let card = session.metadata()?.custom(METADATA_KEY);
    let card = card.with_context(|| format!("has no card: metadata property `{METADATA_KEY}` is missing"))?;
    Ok(Card::from_json(&card)?)
}

/// What an exported model is asked.
#[derive(Clone, Copy, Debug, Default)]
pub struct Asked {
    /// Columns of the grid, if not the sensor's: those of which each pixel holds a ray that was fired.
    pub columns: Option<usize>,
    /// Whether nothing is asked of rays that the vehicle under the sensor hides: see [`Domain::own_vehicle`].
    pub without_own_vehicle: bool,
}

/// Scores a model ray by ray on the real scans of a folder, made to look simulated. Columns beyond the model's multiple are left out at the
/// end. Noise of its own is put at ½.
pub fn score(onnx: &[u8], scans: &Path, asked: Asked) -> Result<Scores> {
    let Asked { columns, without_own_vehicle } = asked;
    let mut card = card(onnx)?;
    let sensor = card.sensor.clone();
    let fired = sensor.clone().with_columns(columns.unwrap_or(sensor.columns()))?;
    let kept = fired.columns() / card.column_multiple * card.column_multiple;
    ensure!(kept > 0, "{} columns are fewer than the model's multiple of {}", fired.columns(), card.column_multiple);
    let mut projector = Projector::new(&fired);
    let mut image = |file: &Path| -> Result<RangeImage> {
        let cloud = formats::read(file, &Limits::default())?;
        Ok(cut_columns(&projector.project(&cloud)?.image, 0, kept))
    };
    let images: Vec<RangeImage> = scan_files(scans)?
        .iter()
        .map(|file| image(file).with_context(|| format!("scan {}", file.display())))
        .collect::<Result<_>>()?;

    card.sensor = sensor.with_columns(kept)?;
    let scans = Domain { images, datasets: vec![] };
    let hidden = if without_own_vehicle { scans.own_vehicle(&card.sensor) } else { vec![] };
    let samples: Vec<Sample> = made_simulated(&scans.images).map(|sample| sample.without(&hidden)).collect();
    let answers = Network::new(onnx, &card)?.generate(samples.iter().map(|sample| &sample.simulated), &card.sensor)?;
    let answers = answers.into_iter().map(|answer| Answer {
        range_m: answer.image.range_m().to_vec(),
        reflectance: answer.image.reflectance().to_vec(),
        keep: answer.keep,
    });
    Ok(scores(samples.into_iter().zip(answers)))
}
