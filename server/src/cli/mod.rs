//! The command line of `realbeam-server`.

mod config_file;
mod log;
mod serve;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::available_parallelism;

use anyhow::Context;
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use lidar::formats::Limits;
use lidar::label::CarlaTags;

use crate::check;
use crate::convert::{self, Conversion};
use crate::generator::{self, Chance};
use crate::inspect;
use crate::model::{MAX_MODEL_BYTES, Model};
use crate::repository::Repository;
use log::LogOptions;
use serve::Serve;

/// Makes simulated lidar scans look like those of a real sensor.
#[derive(Debug, Parser)]
#[command(name = "realbeam-server", version)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Answer scans over HTTP.
    Serve(Box<Serve>),
    /// Convert a file, or every scan of a folder.
    Convert(Box<Convert>),
    /// Print a model's card, inputs and outputs.
    Inspect(ModelChoice),
    /// Check a model, read from stdin; what is wrong goes to stdout. The service starts itself with this.
    #[command(name = check::SUBCOMMAND, hide = true)]
    CheckModel(CheckModel),
}

#[derive(Debug, Args)]
struct CheckModel {
    /// Bytes of address space that the check may have.
    #[arg(long)]
    memory_bytes: u64,
    /// Seconds of CPU time that it may take.
    #[arg(long)]
    time_s: u64,
}

#[derive(Debug, Args)]
struct Convert {
    /// Name of a model, or path of a model.onnx.
    #[arg(long, default_value = "hdl64e")]
    model: String,
    /// Folder of models.
    #[arg(long, env = "REALBEAM_MODELS", default_value = "models")]
    models: PathBuf,
    /// Bytes that a model's file may have; a larger one is not read.
    #[arg(long, env = "REALBEAM_MAX_MODEL_BYTES", default_value_t = MAX_MODEL_BYTES)]
    max_model_bytes: u64,
    /// Version of the model [default: the newest].
    #[arg(long)]
    model_version: Option<u64>,
    /// What chance depends on. A single file is converted as the service does with this seed; each file of a folder gets a seed of its
    /// own from this one and its bytes.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Noise in range and reflectance: drawn by the seed, or none. Which rays are dropped is drawn by the seed either way.
    #[arg(long, default_value = "drawn")]
    noise: Noise,
    /// Frame of the coordinates [default: carla for CARLA's semantic lidar, otherwise ros].
    #[arg(long)]
    frame: Option<Frame>,
    /// CARLA's table of semantic tags.
    #[arg(long, default_value = "0.9.14")]
    tags: Tags,
    /// Points that a scan may have.
    #[arg(long, default_value_t = Limits::default().max_points)]
    max_points: usize,
    /// Bytes that a file may unpack to.
    #[arg(long, default_value_t = Limits::default().max_unpacked_bytes)]
    max_unpacked_bytes: usize,
    /// Threads within an operator [default: all cores].
    #[arg(long, value_parser = positive)]
    threads: Option<usize>,
    #[command(flatten)]
    log: LogOptions,
    /// File or folder to convert; the names tell the formats.
    from: PathBuf,
    /// File or folder to write.
    to: PathBuf,
}

#[derive(Debug, Args)]
struct ModelChoice {
    /// Name of a model, or path of a model.onnx.
    model: String,
    /// Folder of models.
    #[arg(long, env = "REALBEAM_MODELS", default_value = "models")]
    models: PathBuf,
    /// Bytes that a model's file may have; a larger one is not read.
    #[arg(long, env = "REALBEAM_MAX_MODEL_BYTES", default_value_t = MAX_MODEL_BYTES)]
    max_model_bytes: u64,
    /// Version of the model [default: the newest].
    #[arg(long)]
    model_version: Option<u64>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Frame {
    /// x ahead, y left, z up.
    Ros,
    /// x ahead, y right, z up.
    Carla,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Noise {
    /// One of the scans that the sensor could measure.
    Drawn,
    /// The middle of what the sensor could measure, ray by ray.
    Median,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Tags {
    #[value(name = "0.9.13")]
    Until0913,
    #[value(name = "0.9.14")]
    Since0914,
}

impl Cli {
    /// Reads the command line, the environment and, if either names one, the configuration file of `serve`. Ends the process where the
    /// command line is wrong or asks for help.
    pub fn read() -> anyhow::Result<Self> {
        let matches = Self::command().get_matches();
        let file =
            matches.subcommand_matches(serve::NAME).and_then(|matches| matches.get_one::<PathBuf>(serve::CONFIG));
        let matches = match file {
            None => matches,
            Some(file) => config_file::as_defaults(Self::command(), serve::NAME, file)?.get_matches(),
        };
        Ok(Self::from_arg_matches(&matches)?)
    }

    /// Does what the command line says; returns when it is done or the service was stopped.
    pub fn run(self) -> anyhow::Result<()> {
        match self.command {
            Command::Serve(options) => options.run(),
            Command::Convert(options) => options.run(),
            Command::Inspect(choice) => {
                print!("{}", inspect::describe(&choice.read()?));
                Ok(())
            }
            Command::CheckModel(CheckModel { memory_bytes, time_s }) => check::check_stdin(memory_bytes, time_s),
        }
    }
}

impl Convert {
    fn run(self) -> anyhow::Result<()> {
        self.log.start();
        let choice = ModelChoice {
            model: self.model,
            models: self.models,
            max_model_bytes: self.max_model_bytes,
            model_version: self.model_version,
        };
        let carla_tags = match self.tags {
            Tags::Until0913 => CarlaTags::Until0913,
            Tags::Since0914 => CarlaTags::Since0914,
        };
        let noise = match self.noise {
            Noise::Drawn => generator::Noise::Drawn,
            Noise::Median => generator::Noise::Median,
        };
        let conversion = Conversion {
            model: Arc::new(choice.read()?),
            chance: Chance { seed: self.seed, noise },
            frame: self.frame.map(|frame| match frame {
                Frame::Ros => proto::Frame::Ros,
                Frame::Carla => proto::Frame::Carla,
            }),
            limits: Limits { max_points: self.max_points, max_unpacked_bytes: self.max_unpacked_bytes, carla_tags },
            threads: self.threads.unwrap_or_else(cores),
        };
        let files = convert::convert(&conversion, &self.from, &self.to)?;
        tracing::info!("{files} converted");
        Ok(())
    }
}

impl ModelChoice {
    /// Reads the model: from the file if the name is one of an ONNX file, otherwise from the folder of models.
    fn read(&self) -> anyhow::Result<Model> {
        let path = Path::new(&self.model);
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("onnx")) {
            return Ok(Model::read(path, self.max_model_bytes)?);
        }
        let repository = Repository::new(&self.models).with_max_model_bytes(self.max_model_bytes);
        repository.read(&self.model, self.model_version).with_context(|| format!("in folder {}", self.models.display()))
    }
}

fn positive(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| *n > 0).ok_or_else(|| "expected a whole number above 0".into())
}

fn cores() -> usize {
    available_parallelism().map_or(1, usize::from)
}
