//! What a training run is told: one TOML file; everything that is left out has a default, what is misspelt is refused.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use lidar::Sensor;
use serde::{Deserialize, Serialize};

use crate::backend::Backend;
use crate::birds_eye::BirdsEyeConfig;
use crate::network::{COLUMN_MULTIPLE, UNetConfig};
use crate::translation::TranslationConfig;

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
    /// What computes the steps.
    #[serde(default)]
    pub backend: Backend,
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

/// Longest chain of configs of which each extends the next.
const MAX_DEPTH: usize = 8;

/// A config of any kind.
#[derive(Clone, Debug)]
pub enum AnyConfig {
    /// Learning from real scans alone, scored on them.
    Supervised(Box<TrainConfig>),
    /// Translating simulated scans into real ones: whatever names a `method`.
    Translation(Box<TranslationConfig>),
    /// The same of scans seen from above: whatever names a `grid`.
    BirdsEye(Box<BirdsEyeConfig>),
}

impl AnyConfig {
    /// Reads and checks a config file.
    pub fn read(path: &Path) -> Result<Self> {
        let table = read_table(path)?;
        let context = || format!("config {}", path.display());
        Ok(if table.contains_key("method") {
            Self::Translation(Box::new(TranslationConfig::from_table(table).with_context(context)?))
        } else if table.contains_key("grid") {
            Self::BirdsEye(Box::new(BirdsEyeConfig::from_table(table).with_context(context)?))
        } else {
            let config: TrainConfig = table.try_into().with_context(context)?;
            config.check().with_context(context)?;
            Self::Supervised(Box::new(config))
        })
    }
}

/// Reads a config file, beginning with those that it `extends`, one path or several, relative to it: what comes later wins, entry by
/// entry in tables, as a whole in everything else.
pub fn read_table(path: &Path) -> Result<toml::Table> {
    read_extended(path, MAX_DEPTH)
}

fn read_extended(path: &Path, depth: usize) -> Result<toml::Table> {
    ensure!(depth > 0, "config {} extends more than {MAX_DEPTH} others in a row", path.display());
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read config {}", path.display()))?;
    let mut own: toml::Table = toml::from_str(&text).with_context(|| format!("config {}", path.display()))?;
    let bases = match own.remove("extends") {
        None => vec![],
        Some(toml::Value::String(base)) => vec![base],
        Some(bases) => bases.try_into().with_context(|| format!("config {}: extends", path.display()))?,
    };
    let mut table = toml::Table::new();
    for base in bases {
        merge(&mut table, read_extended(&path.with_file_name(base), depth - 1)?);
    }
    merge(&mut table, own);
    Ok(table)
}

/// Puts the keys of a later table over those of an earlier one, table by table.
pub fn merge(table: &mut toml::Table, later: toml::Table) {
    for (key, value) in later {
        match (table.get_mut(&key), value) {
            (Some(toml::Value::Table(before)), toml::Value::Table(value)) => merge(before, value),
            (_, value) => {
                table.insert(key, value);
            }
        }
    }
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
        match AnyConfig::read(path)? {
            AnyConfig::Supervised(config) => Ok(*config),
            AnyConfig::Translation(_) | AnyConfig::BirdsEye(_) => bail!("config {} is a translation's", path.display()),
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_config_changes_what_it_extends_entry_by_entry() -> Result<()> {
        let folder = tempfile::tempdir()?;
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text);
        write("a.toml", "x = 1\ny = [1, 2]\n[t]\np = 1\nq = 2\n")?;
        write("b.toml", "z = 5\n[t]\np = 3\n")?;
        write("c.toml", "extends = [\"a.toml\", \"b.toml\"]\ny = [7]\n")?;
        write("loop.toml", "extends = \"loop.toml\"\n")?;
        let expected: toml::Table = toml::from_str("x = 1\ny = [7]\nz = 5\n[t]\np = 3\nq = 2\n")?;
        assert_eq!(read_table(&folder.path().join("c.toml"))?, expected);
        assert!(read_table(&folder.path().join("loop.toml")).is_err_and(|e| e.to_string().contains("in a row")));
        Ok(())
    }
}
