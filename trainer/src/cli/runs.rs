//! `realbeam-trainer train`, `evaluate`, `export`: runs and what becomes of them.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use trainer::config::AnyConfig;
use trainer::train::{Run, supervised, train};
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
}

#[derive(Debug, Args)]
pub(super) struct EvaluateArgs {
    /// The run's folder.
    run: PathBuf,
    /// Folder that the config's data paths are relative to.
    #[arg(long, default_value = ".")]
    data: PathBuf,
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
            AnyConfig::Supervised(config) => train(&config, &run)?.map(|scores| scores.to_table()),
            AnyConfig::Translation(config) => translation::train(&config, &run)?.map(|scores| scores.to_table()),
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
            AnyConfig::Supervised(config) => Ok(supervised::scores(&config, &self.run, &self.data)?.to_table()),
            AnyConfig::Translation(config) => {
                Ok(translation::training::scores(&config, &self.run, &self.data)?.to_table())
            }
        }
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
