//! What a calibration starts from: an ideal sensor, or an exported model.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use lidar::Sensor;
use proto::card::Card;
use sha2::{Digest, Sha256};

use super::data::Pair;
use super::declared;
use super::model::SensorModel;
use super::network::Network;
use crate::data::scans::hex;
use crate::exported;
use crate::sets::PairedSet;

/// Largest difference of two descriptions of one ray, in radians: what two decimals of a degree leave open.
const SAME_RAY_RAD: f64 = 1e-4;

/// Largest difference of two descriptions of one length, in metres.
const SAME_LENGTH_M: f64 = 1e-3;

/// What a calibration starts from.
#[derive(Clone, Debug)]
pub struct Base {
    /// The model's file; `None` for the ideal sensor, which has none.
    pub file: Option<ModelFile>,
    /// The network in front of the effects, if there is one.
    pub network: Option<Network>,
    /// The noise floor and the effects that the model has already, at its values.
    pub declared: SensorModel,
}

/// The file of an exported model.
#[derive(Clone, Debug)]
pub struct ModelFile {
    /// What it says about itself.
    pub card: Card,
    /// SHA-256 of the file, in hexadecimal.
    pub sha256: String,
}

impl Base {
    /// A sensor that reports what it is shown, but for noise.
    pub fn ideal(sensor: &Sensor) -> Self {
        Self { file: None, network: None, declared: SensorModel::ideal(sensor.rings().len()) }
    }

    /// Reads the exported model of a sensor.
    pub fn read(path: &Path, sensor: &Sensor) -> Result<Self> {
        let model = || format!("model {}", path.display());
        let onnx = std::fs::read(path).with_context(model)?;
        Self::from_onnx(&onnx, sensor).with_context(model)
    }

    fn from_onnx(onnx: &[u8], sensor: &Sensor) -> Result<Self> {
        let card = exported::card(onnx)?;
        check_sensor(&card.sensor, sensor)?;
        let rings = sensor.rings().len();
        let (network, declared) = if card.effects.is_empty() {
            (Some(Network::new(onnx, &card)?), SensorModel::ideal(rings))
        } else {
            (Network::before_effects(onnx)?, declared::read(&card.effects, rings)?)
        };
        Ok(Self { file: Some(ModelFile { card, sha256: hex(&Sha256::digest(onnx)) }), network, declared })
    }

    /// The frames of a set, as this base generates them.
    pub fn pairs(&self, set: &PairedSet) -> Result<Vec<Pair>> {
        let mut pairs = super::calibrate::pairs(set);
        if let Some(network) = &self.network {
            let generated = network.generate(set.frames.iter().map(|frame| &frame.simulated), &set.sensor);
            for (pair, generated) in pairs.iter_mut().zip(generated.context("the model on the set's scans")?) {
                pair.simulated = generated.image;
                pair.keep = Some(generated.keep);
            }
        }
        Ok(pairs)
    }
}

/// A model's rays must be the set's, or residuals would be of the description.
fn check_sensor(model: &Sensor, set: &Sensor) -> Result<()> {
    let same_size = model.rings().len() == set.rings().len() && model.columns() == set.columns();
    let same_rays = model.rings().iter().zip(set.rings()).all(|(a, b)| {
        (a.elevation_rad - b.elevation_rad).abs() < SAME_RAY_RAD
            && (a.azimuth_offset_rad - b.azimuth_offset_rad).abs() < SAME_RAY_RAD
            && (a.height_m - b.height_m).abs() < SAME_LENGTH_M
            && (a.lateral_m - b.lateral_m).abs() < SAME_LENGTH_M
    });
    ensure!(
        same_size && same_rays,
        "the model is one of the sensor {}, the set is one of {}; a set is calibrated against a model of its own sensor",
        described(model),
        described(set)
    );
    Ok(())
}

fn described(sensor: &Sensor) -> String {
    let elevation_deg = |ring: Option<&lidar::sensor::Ring>| ring.map_or(0.0, |r| r.elevation_rad.to_degrees());
    format!(
        "`{}` ({} rings from {:.2}° to {:.2}°, {} columns)",
        sensor.name,
        sensor.rings().len(),
        elevation_deg(sensor.rings().first()),
        elevation_deg(sensor.rings().last()),
        sensor.columns()
    )
}
