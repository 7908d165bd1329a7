//! What training the segmentation network is told: one TOML file.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use lidar::Sensor;
use serde::{Deserialize, Serialize};

use super::darknet::{COLUMN_MULTIPLE, DarknetConfig, RING_MULTIPLE};
use crate::backend::Backend;
use crate::config::load_sensor;

/// A training run.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SegmentationConfig {
    /// One sentence for the card.
    pub summary: String,
    /// Licence that the weights carry.
    pub licence: String,
    /// Anything else for the card.
    #[serde(default)]
    pub notes: String,
    /// Name of a built-in sensor, or path of a sensor's TOML file.
    pub sensor: String,
    /// Columns of a turn.
    pub columns: usize,
    /// Labelled real scans.
    pub labelled: LabelledConfig,
    /// Made-up streets.
    pub streets: StreetsConfig,
    /// What computes the steps.
    #[serde(default)]
    pub backend: Backend,
    /// Seed of the weights, the order of the scans, the streets and what is done to them.
    #[serde(default)]
    pub seed: u64,
    /// The network.
    #[serde(default)]
    pub network: DarknetConfig,
    /// Optimiser steps.
    pub steps: usize,
    /// Cut-outs a step.
    pub batch: usize,
    /// Columns of a cut-out.
    pub crop_columns: usize,
    /// Adam's learning rate at its highest.
    pub learning_rate: f64,
}

/// A folder of labelled scans, in the order in which they were taken.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelledConfig {
    /// Folder, relative to the data root.
    pub path: PathBuf,
    /// What it is, for the card.
    pub source: String,
    /// Its licence.
    pub licence: String,
    /// The last so many are held out.
    pub held_out: usize,
    /// So many before them are left out, being much like them.
    pub left_out: usize,
    /// The sensor by whose elevations these scans were projected before they were published, if they were: half of the streets lose what
    /// such a projection loses, so that holes do not tell streets from real scans.
    #[serde(default)]
    pub projected_by: Option<String>,
}

/// Streets made up from seeds.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StreetsConfig {
    /// Streets to learn from.
    pub learned: usize,
    /// Streets of other seeds that are held out.
    pub held_out: usize,
}

impl SegmentationConfig {
    /// Reads and checks a config file.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read config {}", path.display()))?;
        let config: Self = toml::from_str(&text).with_context(|| format!("config {}", path.display()))?;
        config.check().with_context(|| format!("config {}", path.display()))?;
        Ok(config)
    }

    /// The sensor whose scans the network sees.
    pub fn sensor(&self) -> Result<Sensor> {
        Ok(load_sensor(&self.sensor)?.with_columns(self.columns)?)
    }

    /// The grid that the labelled scans were projected to before they were published, if they were.
    pub fn projected_by(&self) -> Result<Option<Sensor>> {
        let grid = |name: &String| Ok(load_sensor(name)?.with_columns(self.columns)?);
        self.labelled.projected_by.as_ref().map(grid).transpose()
    }

    fn check(&self) -> Result<()> {
        let rings = self.sensor()?.rings().len();
        ensure!(rings.is_multiple_of(RING_MULTIPLE), "{rings} rings are no multiple of {RING_MULTIPLE}");
        for (field, columns) in [("columns", self.columns), ("crop_columns", self.crop_columns)] {
            ensure!(
                columns > 0 && columns.is_multiple_of(2 * COLUMN_MULTIPLE),
                "{field} is {columns}, expected a multiple of {}",
                2 * COLUMN_MULTIPLE
            );
        }
        ensure!(
            2 * self.crop_columns <= self.columns,
            "crop_columns is {}, expected at most half of columns",
            self.crop_columns
        );
        ensure!(self.steps > 0 && self.batch > 0, "steps and batch must be above 0");
        ensure!(self.network.channels.iter().all(|c| *c > 0 && c % 2 == 0), "network.channels must be even");
        ensure!(self.learning_rate > 0.0 && self.learning_rate < 1.0, "learning_rate is {}", self.learning_rate);
        ensure!(self.streets.learned > 0 && self.streets.held_out > 0, "streets must be above 0");
        ensure!(self.labelled.held_out > 0, "labelled.held_out must be above 0");
        Ok(())
    }
}
