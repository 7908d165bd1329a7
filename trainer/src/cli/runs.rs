//! `realbeam-trainer train`, `evaluate`, `export`: runs and what becomes of them.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use burn::tensor::Device;
use clap::Args;
use trainer::backend::Backend;
use trainer::config::{AnyConfig, TrainConfig};
use trainer::exported::{self, Asked};
use trainer::realness::Protocol;
use trainer::segmentation::Segmentation;
use trainer::train::{Run, supervised, train};
use trainer::translation::TranslationConfig;
use trainer::{export, translation};

#[derive(Debug, Args)]
pub(super) struct TrainArgs {
    /// The run's config (TOML).
    config: PathBuf,
    /// Folder that the config's data paths are relative to.
    #[arg(long, default_value = ".")]
    data: PathBuf,
    /// Folder for checkpoints, log and the best network.
    #[arg(long)]
    out: PathBuf,
    /// Go on from the newest checkpoint in OUT.
    #[arg(long)]
    resume: bool,
    /// Stop after this step, with a checkpoint.
    #[arg(long)]
    stop_after: Option<usize>,
    /// What computes the steps, in the place of what the config says.
    #[arg(long, value_enum)]
    backend: Option<Backend>,
    /// Run that is learned from, in the place of the config's: a distilled network answers as its network does, others begin with its weights.
    #[arg(long)]
    teacher: Option<PathBuf>,
    /// Seed, in the place of the config's.
    #[arg(long)]
    seed: Option<u64>,
}

#[derive(Debug, Args)]
pub(super) struct EvaluateArgs {
    /// The run's folder.
    run: PathBuf,
    /// Folder that the config's data paths are relative to.
    #[arg(long, default_value = ".")]
    data: PathBuf,
    /// A translation's: the segmentation network's folder, for every metric of `compare`; without, three quick ones are told.
    #[arg(long)]
    segmentation: Option<PathBuf>,
    /// Whose definitions of these metrics.
    #[arg(long, value_enum, default_value_t, requires = "segmentation")]
    protocol: Protocol,
}

#[derive(Debug, Args)]
pub(super) struct ScoreArgs {
    /// The model's file.
    model: PathBuf,
    /// Real scans of its sensor: a folder, or a file.
    scans: PathBuf,
    /// Columns of a grid of which each pixel holds a ray that was fired, so that an empty one is a ray that was lost; KITTI's has 1800.
    #[arg(long)]
    columns: Option<usize>,
    /// Ask nothing of the rays that the vehicle under the sensor hides, which hardly any of ten scans or more reports: a model may have learned
    /// where they are, and have them lost wherever it is used.
    #[arg(long)]
    without_own_vehicle: bool,
}

#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    /// Folders of runs.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Folder that the configs' data paths are relative to.
    #[arg(long, default_value = ".")]
    data: PathBuf,
    /// Folder of models.
    #[arg(long, default_value = "models")]
    models: PathBuf,
}

impl TrainArgs {
    /// Trains, and prints the scores once training has ended.
    pub(super) fn run(self) -> Result<()> {
        let run = Run { out: self.out, data: self.data, resume: self.resume, stop_after: self.stop_after };
        let table = match AnyConfig::read(&self.config)? {
            AnyConfig::Supervised(config) => {
                ensure!(self.teacher.is_none(), "--teacher: {} is no translation", self.config.display());
                let (backend, seed) = (self.backend.unwrap_or(config.backend), self.seed.unwrap_or(config.seed));
                train(&TrainConfig { backend, seed, ..*config }, &run)?.map(|scores| scores.to_table())
            }
            AnyConfig::Translation(config) => {
                let (backend, seed) = (self.backend.unwrap_or(config.backend), self.seed.unwrap_or(config.seed));
                let config = TranslationConfig { backend, seed, ..*config }.with_teacher(self.teacher)?;
                translation::train(&config, &run)?.map(|scores| scores.to_table())
            }
        };
        if let Some(table) = table {
            println!("{table}");
        }
        Ok(())
    }
}

impl EvaluateArgs {
    /// The scores of the run's best network.
    pub(super) fn table(&self) -> Result<String> {
        match AnyConfig::read(&self.run.join("config.toml"))? {
            AnyConfig::Supervised(_) if self.segmentation.is_some() => {
                bail!(
                    "--segmentation: {} is no translation; judge what it makes of scans with `compare`",
                    self.run.display()
                )
            }
            AnyConfig::Supervised(config) => Ok(supervised::scores(&config, &self.run, &self.data)?.to_table()),
            AnyConfig::Translation(config) => match &self.segmentation {
                None => Ok(translation::training::scores(&config, &self.run, &self.data)?.to_table()),
                Some(folder) => {
                    let network = Segmentation::load(folder, &Device::flex())?;
                    translation::table::evaluate(&config, &self.run, &self.data, (&network, self.protocol))
                }
            },
        }
    }
}

impl ScoreArgs {
    /// The model's scores.
    pub(super) fn table(&self) -> Result<String> {
        let asked = Asked { columns: self.columns, without_own_vehicle: self.without_own_vehicle };
        let score = || -> Result<_> { exported::score(&std::fs::read(&self.model)?, &self.scans, asked) };
        Ok(score().with_context(|| format!("model {}", self.model.display()))?.to_table())
    }
}

impl ExportArgs {
    /// Publishes every run's best network; the first that fails stops those after it.
    pub(super) fn run(self) -> Result<()> {
        for run in &self.runs {
            let publish = || -> Result<PathBuf> {
                let (onnx, card) = export::export(run, &self.data)?;
                export::publish(&self.models, &card, &onnx)
            };
            println!("{}", publish().with_context(|| format!("run {}", run.display()))?.display());
        }
        Ok(())
    }
}
