//! What is told: one TOML file; everything that is left out has a default, what is misspelt is refused.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use lidar::Projector;
use lidar::birds_eye::{CHANNELS, Grid};
use serde::{Deserialize, Serialize};

use crate::backend::Backend;
use crate::config::{load_sensor, read_table};
use crate::network::{Border, PatchGanConfig, ResnetConfig};
use crate::segmentation::DarknetConfig;
use crate::translation::losses::Losses;
use crate::translation::schedule::Schedule;

/// What cells along a side have to be multiples of: the detector's way down.
pub(super) const CELL_MULTIPLE: usize = 16;

/// A translation of scans seen from above, and the detectors that are asked what it is worth.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BirdsEyeConfig {
    /// What computes the steps.
    #[serde(default)]
    pub backend: Backend,
    /// Seed of the weights and of all that is drawn.
    #[serde(default)]
    pub seed: u64,
    /// What is seen.
    pub grid: Grid,
    /// A sensor, by its built-in name or by the path of its TOML file, on whose grid all scans lose the points that a nearer one hides: labelled
    /// real scans were projected before they were published, and what that lost must not tell them from others.
    #[serde(default)]
    pub projected_by: Option<Projected>,
    /// Whether the generator says which cells with returns are lost, and makes none where there are none; otherwise it may show anything
    /// anywhere, as in the paper.
    #[serde(default)]
    pub ray_drop: bool,
    /// The generators.
    #[serde(default)]
    pub generator: ResnetConfig,
    /// The discriminators.
    #[serde(default)]
    pub discriminator: PatchGanConfig,
    /// What the game minimises.
    #[serde(default)]
    pub losses: Losses,
    /// How; `crop_columns` is the side of a cut-out, in cells.
    #[serde(default)]
    pub schedule: Schedule,
    /// Simulated scans.
    pub simulated: Split,
    /// Real ones.
    pub real: Split,
    /// The detectors.
    #[serde(default)]
    pub detector: DetectorConfig,
}

/// See [`BirdsEyeConfig::projected_by`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Projected {
    /// The sensor.
    pub sensor: String,
    /// Columns of its turn.
    pub columns: usize,
}

/// Folders of one domain's scans, relative to the data root.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// What is learned from.
    pub train: Vec<PathBuf>,
    /// What the best network is chosen on.
    pub validate: Vec<PathBuf>,
}

/// A detector's size and budget.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DetectorConfig {
    /// The network.
    pub network: DarknetConfig,
    /// Optimiser steps.
    pub steps: usize,
    /// Scans a step.
    pub batch: usize,
    /// Adam's learning rate at its highest; it rises over the first twentieth of the steps, and falls along half a cosine.
    pub learning_rate: f64,
}

impl Default for DetectorConfig {
    fn default() -> Self {
        Self { network: DarknetConfig::default(), steps: 500, batch: 2, learning_rate: 4e-3 }
    }
}

impl BirdsEyeConfig {
    /// Reads and checks a config file, with what it extends.
    pub fn read(path: &Path) -> Result<Self> {
        Self::from_table(read_table(path)?).with_context(|| format!("config {}", path.display()))
    }

    /// Checks a config.
    pub fn from_table(table: toml::Table) -> Result<Self> {
        let mut config: Self = table.try_into()?;
        config.check()?;
        config.generator.channels = CHANNELS;
        config.discriminator.channels = CHANNELS;
        Ok(config)
    }

    /// The config as TOML.
    pub fn to_toml(&self) -> Result<String> {
        Ok(toml::to_string(self)?)
    }

    /// What takes hidden points out of scans, if that is asked for.
    pub fn projector(&self) -> Result<Option<Projector>> {
        let grid = |Projected { sensor, columns }: &Projected| -> Result<_> {
            Ok(Projector::new(&load_sensor(sensor)?.with_columns(*columns)?).by_elevation())
        };
        self.projected_by.as_ref().map(grid).transpose()
    }

    fn check(&self) -> Result<()> {
        let (g, s, d) = (&self.generator, &self.schedule, &self.detector);
        self.grid.check()?;
        self.projector()?;
        let cells = self.grid.cells();
        ensure!(
            cells.is_multiple_of(CELL_MULTIPLE),
            "grid: {cells} cells along a side are no multiple of {CELL_MULTIPLE}"
        );
        ensure!(
            s.crop_columns > 0 && s.crop_columns <= cells && s.crop_columns.is_multiple_of(g.multiple()),
            "schedule.crop_columns is {}, expected a multiple of {} up to the grid's {cells} cells",
            s.crop_columns,
            g.multiple()
        );
        ensure!(
            self.discriminator.fits(s.crop_columns),
            "schedule.crop_columns: {} cells hold no patch of the discriminator",
            s.crop_columns
        );
        for (name, number) in [
            ("schedule.steps", s.steps),
            ("schedule.batch", s.batch),
            ("schedule.checkpoint_every", s.checkpoint_every),
            ("detector.steps", d.steps),
            ("detector.batch", d.batch),
            ("generator.width", g.width),
            ("discriminator.width", self.discriminator.width),
        ] {
            ensure!(number > 0, "{name} must be above 0");
        }
        for (name, rate) in [("schedule", s.learning_rate), ("detector", d.learning_rate)] {
            ensure!(rate > 0.0 && rate < 1.0, "{name}.learning_rate is {rate}, expected more than 0, less than 1");
        }
        ensure!((0.0..1.0).contains(&s.average), "schedule.average is {}, expected 0 or more, less than 1", s.average);
        ensure!(d.network.channels.iter().all(|c| *c > 0 && c % 2 == 0), "detector.network.channels must be even");
        ensure!(
            g.border == Border::Mirror && !g.condition && g.rings == 0 && !g.relief && !g.scatter,
            "generator: from above there are no turns, labels, rings, relief or scatter; expected border = \"mirror\", condition = false"
        );
        for (domain, name) in [(&self.simulated, "simulated"), (&self.real, "real")] {
            ensure!(!domain.train.is_empty() && !domain.validate.is_empty(), "no {name}.train or no {name}.validate");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "[grid]\nreach_m = 16.0\ncell_m = 0.25\nheight_m = [-2.0, 2.0]\n[generator]\nborder = \"mirror\"\ncondition = false\n\
                        [schedule]\ncrop_columns = 64\n[simulated]\ntrain = [\"a\"]\nvalidate = [\"b\"]\n[real]\ntrain = [\"c\"]\nvalidate = [\"d\"]\n";

    fn parse(text: &str) -> Result<BirdsEyeConfig> {
        BirdsEyeConfig::from_table(toml::from_str(text)?)
    }

    #[test]
    fn a_config_survives_its_toml_and_what_would_mislead_is_refused() -> Result<()> {
        let config = parse(TEXT)?;
        assert_eq!((config.generator.channels, config.discriminator.channels), (CHANNELS, CHANNELS));
        assert_eq!(parse(&config.to_toml()?)?.to_toml()?, config.to_toml()?);
        for (from, to, word) in [
            ("cell_m = 0.25", "cell_m = 0.0", "cells of 0 m"),
            ("cell_m = 0.25", "cell_m = 0.3", "107 cells along a side"),
            ("crop_columns = 64", "crop_columns = 256", "schedule.crop_columns is 256"),
            ("crop_columns = 64", "crop_columns = 16", "hold no patch"),
            ("border = \"mirror\"", "border = \"turn\"", "expected border"),
            ("crop_columns = 64", "crop_columns = 64\naverage = 1.0", "schedule.average"),
            ("train = [\"c\"]", "train = []", "no real.train"),
            ("[grid]", "projected_by = { sensor = \"hdl9\", columns = 64 }\n[grid]", "hdl9"),
            ("[grid]", "ray_dorp = true\n[grid]", "ray_dorp"),
        ] {
            let refused = parse(&TEXT.replace(from, to)).map_or_else(|e| format!("{e:#}"), |_| String::new());
            assert!(refused.contains(word), "{to}: {refused}");
        }
        Ok(())
    }
}
