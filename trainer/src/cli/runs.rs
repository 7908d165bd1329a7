//! `realbeam-trainer train`, `evaluate`, `export`: runs and what becomes of them.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use burn::tensor::Device;
use clap::Args;
use lidar::ray_drop::Bursts;
use proto::card::Card;
use trainer::backend::Backend;
use trainer::birds_eye::{self, BirdsEyeConfig};
use trainer::config::{AnyConfig, TrainConfig};
use trainer::drop_bursts::Lost;
use trainer::exported::{self, Answered, Asked};
use trainer::realness::Protocol;
use trainer::scatter::Scatter;
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
    /// Only this sector of every scan: azimuth from and to, in degrees (180 is behind, 90 left), from > to.
    #[arg(long, num_args = 2, value_names = ["FROM", "TO"], allow_negative_numbers = true)]
    sector_deg: Option<Vec<f64>>,
    /// Ask nothing of the rays that the vehicle under the sensor hides, which hardly any of ten scans or more reports: a model may have learned
    /// where they are, and have them lost wherever it is used.
    #[arg(long)]
    without_own_vehicle: bool,
}

#[derive(Debug, Args)]
pub(super) struct BurstsArgs {
    #[command(flatten)]
    score: ScoreArgs,
    /// Publish the model, told the bursts of these scans, as its next version under this folder.
    #[arg(long)]
    models: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct ScatterArgs {
    #[command(flatten)]
    score: ScoreArgs,
    /// Publish the model, its reflectances scattered so, as its next version under this folder.
    #[arg(long)]
    models: Option<PathBuf>,
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
            AnyConfig::BirdsEye(config) => {
                ensure!(self.teacher.is_none(), "--teacher: what is seen from above has no teacher");
                let (backend, seed) = (self.backend.unwrap_or(config.backend), self.seed.unwrap_or(config.seed));
                birds_eye::training::train(&BirdsEyeConfig { backend, seed, ..*config }, &run)?
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
            AnyConfig::BirdsEye(_) if self.segmentation.is_some() => {
                bail!("--segmentation: {} is no translation of range images", self.run.display())
            }
            AnyConfig::BirdsEye(_) => birds_eye::training::evaluate(&self.run, &self.data),
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
        let score = || -> Result<_> { exported::score(&std::fs::read(&self.model)?, &self.scans, self.asked()) };
        Ok(score().with_context(|| format!("model {}", self.model.display()))?.to_table())
    }

    fn asked(&self) -> Asked {
        let sector_deg = self.sector_deg.as_deref().and_then(|sector| <[f64; 2]>::try_from(sector).ok());
        Asked { columns: self.columns, sector_deg, without_own_vehicle: self.without_own_vehicle }
    }
}

impl BurstsArgs {
    /// How lost rays hang together in the scans, beside the bursts of the model's card, or, where it names none or a new version is published,
    /// those that come nearest.
    pub(super) fn run(&self) -> Result<()> {
        let ScoreArgs { model, scans, .. } = &self.score;
        let measure = || -> Result<()> {
            let onnx = std::fs::read(model)?;
            let Answered { scans, card, column_deg } = exported::ask(&onnx, scans, self.score.asked())?;
            let lost = Lost::count(&scans, column_deg);
            let fitted = lost.fit()?;
            let keeps = self.models.is_none() && !card.drop_bursts.is_empty();
            let shown = if keeps { &card.drop_bursts } else { &fitted };
            println!(
                "{}\n{}; nearest to these {} scans: {}.",
                lost.to_table(shown),
                if keeps { "In the card's bursts" } else { "In the nearest bursts" },
                scans.len(),
                said(&fitted)
            );
            if let Some(models) = &self.models {
                let (onnx, card) = exported::told(&onnx, Card { drop_bursts: fitted, ..card })?;
                println!("{}", export::publish(models, &card, &onnx)?.display());
            }
            Ok(())
        };
        measure().with_context(|| format!("model {}", model.display()))
    }
}

impl ScatterArgs {
    /// What is reported where the model says so much, and how this hangs together.
    pub(super) fn run(&self) -> Result<()> {
        let ScoreArgs { model, scans, .. } = &self.score;
        let measure = || -> Result<()> {
            let onnx = std::fs::read(model)?;
            let Answered { scans, card, column_deg } = exported::ask(&onnx, scans, self.score.asked())?;
            let scatter = Scatter::measure(&scans, column_deg)?;
            println!("{}\nOf {} scans; {scatter}.", scatter.to_table(), scans.len());
            if let Some(models) = &self.models {
                let (onnx, card) = scatter.behind(&onnx, card)?;
                println!("{}", export::publish(models, &card, &onnx)?.display());
            }
            Ok(())
        };
        measure().with_context(|| format!("model {}", model.display()))
    }
}

/// Bursts in a sentence.
fn said(bursts: &Bursts) -> String {
    let all: Vec<String> = bursts.as_slice().iter().map(ToString::to_string).collect();
    if all.is_empty() { "none".into() } else { all.join(", ") }
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
