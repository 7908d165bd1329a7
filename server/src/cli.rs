//! The command line of `realbeam-server`.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::available_parallelism;
use std::time::Duration;

use anyhow::Context;
use clap::{Args, Parser, Subcommand, ValueEnum};
use lidar::formats::Limits;
use lidar::label::CarlaTags;

use crate::catalogue::WorkerOptions;
use crate::convert::{self, Conversion};
use crate::generator::{self, Chance};
use crate::inspect;
use crate::model::Model;
use crate::repository::Repository;
use crate::serve::{self, Config};

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
    Serve(Serve),
    /// Convert a file, or every scan of a folder.
    Convert(Convert),
    /// Print a model's card, inputs and outputs.
    Inspect(ModelChoice),
}

#[derive(Debug, Args)]
struct Serve {
    /// Folder of models: <NAME>/<VERSION>/model.onnx.
    #[arg(long, env = "REALBEAM_MODELS", default_value = "models")]
    models: PathBuf,
    /// Model that is used where a request names none.
    #[arg(long, env = "REALBEAM_DEFAULT_MODEL", default_value = "hdl64e")]
    default_model: String,
    /// Address to listen at; port 0 takes a free one.
    #[arg(long, env = "REALBEAM_ADDR", default_value = "127.0.0.1:8080")]
    addr: SocketAddr,
    /// Worker threads of each model, each with a session of its own.
    #[arg(long, env = "REALBEAM_WORKERS", default_value_t = 1, value_parser = positive)]
    workers: usize,
    /// Threads within an operator, for each worker [default: all cores].
    #[arg(long, env = "REALBEAM_THREADS", value_parser = positive)]
    threads: Option<usize>,
    /// Scans that may wait for a worker before others are turned away with 429.
    #[arg(long, env = "REALBEAM_QUEUE", default_value_t = 32, value_parser = positive)]
    queue: usize,
    /// Bytes that a body may have.
    #[arg(long, env = "REALBEAM_MAX_BODY_BYTES", default_value_t = 64 << 20)]
    max_body_bytes: usize,
    /// Points that a scan may have.
    #[arg(long, env = "REALBEAM_MAX_POINTS", default_value_t = Limits::default().max_points)]
    max_points: usize,
    /// Seconds that requests under way get to finish when the service is told to stop.
    #[arg(long, env = "REALBEAM_GRACE_S", default_value_t = 30)]
    grace_s: u64,
}

#[derive(Debug, Args)]
struct Convert {
    /// Name of a model, or path of a model.onnx.
    #[arg(long, default_value = "hdl64e")]
    model: String,
    /// Folder of models.
    #[arg(long, env = "REALBEAM_MODELS", default_value = "models")]
    models: PathBuf,
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
    /// Threads within an operator [default: all cores].
    #[arg(long, value_parser = positive)]
    threads: Option<usize>,
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
    /// Does what the command line says; returns when it is done or the service was stopped.
    pub fn run(self) -> anyhow::Result<()> {
        match self.command {
            Command::Serve(options) => options.run(),
            Command::Convert(options) => options.run(),
            Command::Inspect(choice) => {
                print!("{}", inspect::describe(&choice.read()?));
                Ok(())
            }
        }
    }
}

impl Serve {
    fn run(self) -> anyhow::Result<()> {
        let server = serve::serve(&Config {
            models: self.models,
            default_model: self.default_model,
            addr: self.addr,
            workers: WorkerOptions {
                workers: self.workers,
                threads: self.threads.unwrap_or_else(cores),
                queue: self.queue,
            },
            max_body_bytes: self.max_body_bytes,
            max_points: self.max_points,
            grace: Duration::from_secs(self.grace_s),
        })?;
        tracing::info!("listening at http://{}", server.addr());
        Ok(server.stop_at_signal()?)
    }
}

impl Convert {
    fn run(self) -> anyhow::Result<()> {
        let choice = ModelChoice { model: self.model, models: self.models, model_version: self.model_version };
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
            limits: Limits { max_points: self.max_points, carla_tags },
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
            return Ok(Model::read(path)?);
        }
        let repository = Repository::new(&self.models);
        repository.read(&self.model, self.model_version).with_context(|| format!("in folder {}", self.models.display()))
    }
}

fn positive(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| *n > 0).ok_or_else(|| "expected a whole number above 0".into())
}

fn cores() -> usize {
    available_parallelism().map_or(1, usize::from)
}
