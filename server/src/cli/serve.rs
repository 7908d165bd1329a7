//! `realbeam-server serve`: what the service can be told.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use lidar::formats::Limits;

use super::log::LogOptions;
use super::{cores, positive};
use crate::catalogue::WorkerOptions;
use crate::serve::{self, Config};

/// Name of the subcommand.
pub(super) const NAME: &str = "serve";

/// Id of the option that names the configuration file.
pub(super) const CONFIG: &str = "config";

/// Every option is also an environment variable, and a key of the configuration file: `max_body_bytes = 1000000` there is
/// `--max-body-bytes 1000000` here. The command line counts before the environment, and that before the file.
#[derive(Debug, Args)]
pub(super) struct Serve {
    /// Configuration file (TOML); a key that is no option's name is an error.
    #[arg(long, env = "REALBEAM_CONFIG", value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    log: LogOptions,
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

impl Serve {
    /// Serves until the service is told to stop.
    pub(super) fn run(self) -> anyhow::Result<()> {
        self.log.start();
        if let Some(file) = &self.config {
            tracing::info!("configured by {}", file.display());
        }
        let server = serve::serve(&self.into_config())?;
        tracing::info!("listening at http://{}", server.addr());
        Ok(server.stop_at_signal()?)
    }

    fn into_config(self) -> Config {
        let workers =
            WorkerOptions { workers: self.workers, threads: self.threads.unwrap_or_else(cores), queue: self.queue };
        Config {
            models: self.models,
            default_model: self.default_model,
            addr: self.addr,
            workers,
            max_body_bytes: self.max_body_bytes,
            max_points: self.max_points,
            grace: Duration::from_secs(self.grace_s),
        }
    }
}
