//! Exported models, by their files alone.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use lidar::RangeImage;
use proto::card::{Card, METADATA_KEY};

use crate::closed_loop::network::Network;
use crate::config::DataConfig;
use crate::data::Scans;
use crate::data::sample::Sample;
use crate::data::scans::cut_columns;
use crate::drop_bursts::Lost;
use crate::evaluate::{Scores, made_simulated, scores};
use crate::generator::Answer;
use crate::scatter::Scatter;
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
    /// Only this sector of every scan; see [`DataConfig::sector_deg`].
    pub sector_deg: Option<[f64; 2]>,
    /// Whether nothing is asked of rays that the vehicle under the sensor hides: see [`Domain::own_vehicle`].
    pub without_own_vehicle: bool,
}

/// A model's answers to real scans that were made to look simulated.
#[derive(Clone, Debug)]
pub struct Answered {
    /// The scans, each with its answer.
    pub scans: Vec<(Sample, Answer)>,
    /// The card in the model's file.
    pub card: Card,
    /// Distance of two columns of the scans, in degrees of azimuth.
    pub column_deg: f64,
}

/// Has a model answer the real scans of a folder, made to look simulated. Columns beyond the model's multiple are left out at the end. Noise
/// of its own is put at ½.
pub fn ask(onnx: &[u8], scans: &Path, asked: Asked) -> Result<Answered> {
    let card = card(onnx)?;
    let Asked { columns, sector_deg, without_own_vehicle } = asked;
    let folder = DataConfig {
        path: scans.to_owned(),
        source: String::new(),
        licence: String::new(),
        columns,
        drops_observed: true,
        sector_deg,
    };
    let images = Scans::load(Path::new(""), &folder, &card.sensor)?.images;
    let column_deg = 360.0 / columns.unwrap_or(card.sensor.columns()) as f64;
    Ok(Answered { scans: answer(onnx, &card, &images, without_own_vehicle)?, card, column_deg })
}

/// A model's answers to range images of real scans, made to look simulated; all of one size.
fn answer(onnx: &[u8], card: &Card, images: &[RangeImage], without_own_vehicle: bool) -> Result<Vec<(Sample, Answer)>> {
    let columns = images.first().map_or(0, RangeImage::columns);
    let kept = columns / card.column_multiple * card.column_multiple;
    ensure!(kept > 0, "{columns} columns are fewer than the model's multiple of {}", card.column_multiple);
    let sensor = card.sensor.clone().with_columns(kept)?;
    let scans = Domain { images: images.iter().map(|image| cut_columns(image, 0, kept)).collect(), datasets: vec![] };
    let hidden = if without_own_vehicle { scans.own_vehicle(&sensor) } else { vec![] };
    let samples: Vec<Sample> = made_simulated(&scans.images).map(|sample| sample.without(&hidden)).collect();
    let card = Card { sensor: sensor.clone(), ..card.clone() };
    let answers = Network::new(onnx, &card)?.generate(samples.iter().map(|sample| &sample.simulated), &sensor)?;
    let answers = answers.into_iter().map(|answer| Answer {
        range_m: answer.image.range_m().to_vec(),
        reflectance: answer.image.reflectance().to_vec(),
        keep: answer.keep,
        scatter: None,
    });
    Ok(samples.into_iter().zip(answers).collect())
}

/// The same model with what real scans show of it that it cannot say of each ray: which are lost together, and, where it says the
/// `middle` of them, how reflectances scatter about that. Measured on the scans that it learned from: those of one width whose drops were observed.
pub fn with_measured(
    onnx: Vec<u8>,
    card: Card,
    data_root: &Path,
    learned: &[DataConfig],
    middle: bool,
) -> Result<(Vec<u8>, Card)> {
    let observed: Vec<&DataConfig> = learned.iter().filter(|data| data.drops_observed).collect();
    let Some(first) = observed.first() else { return Ok((onnx, card)) };
    let alike = observed.iter().filter(|data| (data.columns, data.sector_deg) == (first.columns, first.sector_deg));
    let mut images = vec![];
    for data in alike {
        images.extend(Scans::load(data_root, data, &card.sensor)?.images);
    }
    let column_deg = 360.0 / first.columns.unwrap_or(card.sensor.columns()) as f64;
    let answered = answer(&onnx, &card, &images, true)?;
    let drop_bursts = Lost::count(&answered, column_deg).fit()?;
    let (onnx, card) = told(&onnx, Card { drop_bursts, ..card })?;
    if middle { Scatter::measure(&answered, column_deg)?.behind(&onnx, card) } else { Ok((onnx, card)) }
}

/// The same model with another card.
pub fn told(onnx: &[u8], card: Card) -> Result<(Vec<u8>, Card)> {
    Ok((onnx::with_metadata(onnx, METADATA_KEY, &card.to_json())?, card))
}

/// Scores a model ray by ray; see [`ask`].
pub fn score(onnx: &[u8], scans: &Path, asked: Asked) -> Result<Scores> {
    Ok(scores(ask(onnx, scans, asked)?.scans))
}
