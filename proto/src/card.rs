//! The model card: everything about a model that its tensors do not say, one JSON document inside `model.onnx`.

use lidar::Sensor;
use lidar::ray_drop::Bursts;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Key of the ONNX metadata property that holds the card.
pub const METADATA_KEY: &str = "realbeam";

/// Version of the card's schema that this code writes and reads.
pub const SCHEMA: u32 = 1;

/// Names of the graph's inputs and outputs.
///
/// | tensor | shape, float32 | meaning |
/// |---|---|---|
/// | `scan` in | `[batch, 3, ring, column]` | range in m (0 = no return), reflectance 0–1, class index of SemanticKITTI's learning map (0 = unlabelled) |
/// | `noise` in | `[batch, noise_channels, ring, column]` | independent uniform numbers in [0, 1); absent where `noise_channels` is 0 |
/// | `range` out | `[batch, 1, ring, column]` | m |
/// | `reflectance` out | `[batch, 1, ring, column]` | 0–1 |
/// | `keep` out | `[batch, 1, ring, column]` | probability that the sensor reports the ray |
pub mod tensor {
    /// Range, reflectance and class of the simulated scan.
    pub const SCAN: &str = "scan";
    /// The graph's only source of randomness.
    pub const NOISE: &str = "noise";
    /// Measured range.
    pub const RANGE: &str = "range";
    /// Measured reflectance.
    pub const REFLECTANCE: &str = "reflectance";
    /// Probability that the ray is reported.
    pub const KEEP: &str = "keep";
    /// Channels of `scan`.
    pub const SCAN_CHANNELS: usize = 3;
}

/// Most noise channels that a model may ask for.
pub const MAX_NOISE_CHANNELS: usize = 16;

/// What a model is, does, was trained on and scored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The model's name, as in `models/<name>/<version>/`.
    pub name: String,
    /// One sentence.
    pub summary: String,
    /// SPDX identifier or name of the licence that the weights carry.
    pub licence: String,
    /// The sensor that the model imitates; its rings are the graph's `ring` axis, its columns what scans are projected to.
    pub sensor: Sensor,
    /// The number of columns is a multiple of this.
    pub column_multiple: usize,
    /// Channels of the `noise` input; 0 = the graph has no such input.
    pub noise_channels: usize,
    /// The outputs count on every ray: where the simulated scan has no return, `keep` is the probability that the sensor reports one
    /// all the same (rain, blooming, random returns), and `range` and `reflectance` are that return's. Where this is false, what the
    /// graph says of such rays is nothing that a sensor reports.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub adds_returns: bool,
    /// How lost rays hang together along their ring; where nothing is said, every ray is decided for itself.
    #[serde(default, skip_serializing_if = "Bursts::is_empty")]
    pub drop_bursts: Bursts,
    /// Names of the classes, by the index that the class channel of `scan` takes.
    pub classes: Vec<String>,
    /// Sensor effects in the graph, in the order in which they act.
    #[serde(default)]
    pub effects: Vec<Effect>,
    /// What the model learned from.
    #[serde(default)]
    pub trained_on: Vec<Dataset>,
    /// How well it does on data that it did not learn from.
    #[serde(default)]
    pub scores: Vec<Score>,
    /// Free text: how it was trained, what it cannot do.
    #[serde(default)]
    pub notes: String,
}

/// A sensor effect with its fitted parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Identifier in the library of effects.
    pub name: String,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
}

/// A fitted number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Name with unit, such as `offset_deg`.
    pub name: String,
    /// Estimate.
    pub value: f64,
    /// Its standard error.
    pub stderr: Option<f64>,
}

/// Data that a model learned from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dataset {
    /// What it is and where it comes from.
    pub name: String,
    /// Its licence.
    pub licence: String,
    /// Number of scans.
    pub scans: usize,
    /// SHA-256 over the files' SHA-256 in order of their names.
    pub sha256: String,
}

/// One score on held-out data, beside what doing nothing scores.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// The metric.
    pub metric: String,
    /// Its unit; empty for pure numbers.
    pub unit: String,
    /// The model's score.
    pub model: f64,
    /// The pass-through's: every ray kept, the simulated reflectance and range taken as they are.
    pub pass_through: f64,
    /// Scans that it was measured on.
    pub scans: usize,
}

/// A card that this code cannot take.
#[derive(Debug, Error)]
pub enum CardError {
    /// The JSON does not parse.
    #[error("model card: {0}")]
    Json(#[from] serde_json::Error),
    /// Another schema.
    #[error("model card: schema is {0}, expected {SCHEMA}")]
    Schema(u32),
    /// A number out of bounds.
    #[error("model card: {field} is {found}, expected {expected}")]
    OutOfBounds {
        /// The field.
        field: &'static str,
        /// What it is.
        found: usize,
        /// What it may be.
        expected: String,
    },
}

impl Card {
    /// Reads a card and checks it.
    pub fn from_json(text: &str) -> Result<Self, CardError> {
        let card: Self = serde_json::from_str(text)?;
        if card.schema != SCHEMA {
            return Err(CardError::Schema(card.schema));
        }
        if card.noise_channels > MAX_NOISE_CHANNELS {
            let expected = format!("at most {MAX_NOISE_CHANNELS}");
            return Err(CardError::OutOfBounds { field: "noise_channels", found: card.noise_channels, expected });
        }
        let columns = card.sensor.columns();
        if card.column_multiple == 0 || !columns.is_multiple_of(card.column_multiple) {
            let expected = format!("a divisor of the sensor's {columns} columns");
            return Err(CardError::OutOfBounds { field: "column_multiple", found: card.column_multiple, expected });
        }
        Ok(card)
    }

    /// The JSON that goes into the ONNX file.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).unwrap_or_else(|_| unreachable!("a card is plain numbers and strings"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn card() -> Result<Card, lidar::sensor::SensorError> {
        Ok(Card {
            schema: SCHEMA,
            name: "test".into(),
            summary: "A test".into(),
            licence: "MIT".into(),
            sensor: Sensor::builtin("hdl32e")?,
            column_multiple: 8,
            noise_channels: 0,
            adds_returns: false,
            drop_bursts: Bursts::default(),
            classes: vec!["unlabelled".into()],
            effects: vec![],
            trained_on: vec![],
            scores: vec![],
            notes: String::new(),
        })
    }

    #[test]
    fn a_card_survives_its_json() -> Result<(), Box<dyn std::error::Error>> {
        let card = card()?;
        assert_eq!(Card::from_json(&card.to_json())?.to_json(), card.to_json());
        Ok(())
    }

    #[test]
    fn a_card_that_does_not_say_so_adds_no_returns() -> Result<(), Box<dyn std::error::Error>> {
        let silent = card()?;
        assert!(!silent.to_json().contains("adds_returns"), "readers of older cards take it");
        assert!(!Card::from_json(&silent.to_json())?.adds_returns);
        let adding = Card { adds_returns: true, ..silent };
        assert!(Card::from_json(&adding.to_json())?.adds_returns);
        Ok(())
    }

    #[test]
    fn cards_that_would_mislead_are_refused() -> Result<(), Box<dyn std::error::Error>> {
        let refused = |edit: fn(&mut Card)| -> Result<String, lidar::sensor::SensorError> {
            let mut card = card()?;
            edit(&mut card);
            Ok(Card::from_json(&card.to_json()).map_or_else(|e| e.to_string(), |_| String::new()))
        };
        assert!(refused(|c| c.schema = 2)?.contains("schema is 2"));
        assert!(refused(|c| c.column_multiple = 7)?.contains("column_multiple is 7"));
        assert!(refused(|c| c.noise_channels = 1 << 40)?.contains("noise_channels"));
        assert_eq!(refused(|_| {})?, "");
        Ok(())
    }
}
