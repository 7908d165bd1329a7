//! What a training run is told: one TOML file; everything that is left out has a default, what is misspelt is refused.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use lidar::Sensor;
use serde::{Deserialize, Serialize};

use crate::network::{COLUMN_MULTIPLE, UNetConfig};

/// A training run.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Name of the model.
    pub name: String,
    /// One sentence for the card.
    pub summary: String,
    /// Licence that the weights carry.
    pub licence: String,
    /// Anything else for the card.
    #[serde(default)]
    pub notes: String,
    /// Name of a built-in sensor, or path of a sensor's TOML file.
    pub sensor: String,
    /// Columns of the sensor's turn, if other than the built-in sensor's.
    #[serde(default)]
    pub columns: Option<usize>,
    /// Seed of the weights, the order of the scans and the augmentation.
    #[serde(default)]
    pub seed: u64,
    /// The network.
    #[serde(default)]
    pub network: UNetConfig,
    /// How it learns.
    #[serde(default)]
    pub schedule: Schedule,
    /// What it learns from.
    pub train: Vec<DataConfig>,
    /// What the best checkpoint is chosen on.
    pub validate: Vec<DataConfig>,
    /// What the scores are measured on, once, at the end.
    pub test: Vec<DataConfig>,
}

/// How a network learns.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Schedule {
    /// Optimiser steps.
    pub steps: usize,
    /// Cut-outs a step.
    pub batch: usize,
    /// Columns of a cut-out.
    pub crop_columns: usize,
    /// Adam's learning rate at its highest; it rises over the first 2 % of the steps and falls to 1 % of it along a cosine.
    pub learning_rate: f64,
    /// Steps between two checkpoints; each is scored on the validation scans.
    pub checkpoint_every: usize,
    /// Weight of the reflectance's L1 loss beside the keep mask's cross-entropy.
    pub reflectance_weight: f32,
    /// Weight of the range's L1 loss, taken on ln(r + 1).
    pub range_weight: f32,
}

impl Default for Schedule {
    fn default() -> Self {
        Self {
            steps: 4000,
            batch: 4,
            crop_columns: 256,
            learning_rate: 2e-3,
            checkpoint_every: 250,
            reflectance_weight: 4.0,
            range_weight: 2.0,
        }
    }
}

/// A folder of scans.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataConfig {
    /// Folder (or file), relative to the data root.
    pub path: PathBuf,
    /// What it is, for the card.
    pub source: String,
    /// Its licence.
    pub licence: String,
    /// Columns that these scans are projected to, if other than the sensor's.
    #[serde(default)]
    pub columns: Option<usize>,
    /// Whether an empty pixel is a ray that the sensor did not report. False for scans that were motion-compensated or
    /// resampled: their empty pixels are artefacts, and only their reflectance and range are learned from.
    #[serde(default = "yes")]
    pub drops_observed: bool,
    /// Only this sector of every scan: azimuth from, to in degrees (180 is behind, 90 left, −90 right), from > to.
    #[serde(default)]
    pub sector_deg: Option<[f64; 2]>,
}

fn yes() -> bool {
    true
}

/// A sensor by its built-in name or by the path of its TOML file.
pub fn load_sensor(name: &str) -> Result<Sensor> {
    if Path::new(name).extension().is_some_and(|extension| extension == "toml") {
        let text = std::fs::read_to_string(name).with_context(|| format!("cannot read sensor {name}"))?;
        return Sensor::from_toml(&text).with_context(|| format!("sensor {name}"));
    }
    Ok(Sensor::builtin(name)?)
}

impl TrainConfig {
    /// Reads and checks a config file.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read config {}", path.display()))?;
        let config: Self = toml::from_str(&text).with_context(|| format!("config {}", path.display()))?;
        config.check().with_context(|| format!("config {}", path.display()))?;
        Ok(config)
    }

    /// The config as TOML.
    pub fn to_toml(&self) -> Result<String> {
        Ok(toml::to_string(self)?)
    }

    /// The sensor that the model imitates.
    pub fn sensor(&self) -> Result<Sensor> {
        let sensor = load_sensor(&self.sensor)?;
        match self.columns {
            Some(columns) => Ok(sensor.with_columns(columns)?),
            None => Ok(sensor),
        }
    }

    fn check(&self) -> Result<()> {
        let sensor = self.sensor()?;
        let (rings, columns) = (sensor.rings().len(), sensor.columns());
        ensure!(rings.is_multiple_of(COLUMN_MULTIPLE), "{rings} rings are no multiple of {COLUMN_MULTIPLE}");
        ensure!(columns.is_multiple_of(COLUMN_MULTIPLE), "{columns} columns are no multiple of {COLUMN_MULTIPLE}");
        let s = &self.schedule;
        ensure!(
            s.steps > 0 && s.batch > 0 && s.checkpoint_every > 0,
            "steps, batch and checkpoint_every must be above 0"
        );
        ensure!(
            s.crop_columns >= COLUMN_MULTIPLE && s.crop_columns.is_multiple_of(COLUMN_MULTIPLE),
            "crop_columns is {}, expected a multiple of {COLUMN_MULTIPLE}",
            s.crop_columns
        );
        ensure!(s.learning_rate > 0.0 && s.learning_rate < 1.0, "learning_rate is {}", s.learning_rate);
        for (list, name) in [(&self.train, "train"), (&self.validate, "validate"), (&self.test, "test")] {
            ensure!(!list.is_empty(), "no [[{name}]] data");
        }
        for data in self.validate.iter().chain(&self.test) {
            ensure!(data.drops_observed, "{}: scores need scans whose drops were observed", data.path.display());
        }
        Ok(())
    }
}
