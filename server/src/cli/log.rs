//! What the log shows, and how.

use std::io::{IsTerminal, stderr};

use clap::{Args, ValueEnum};
use tracing_subscriber::EnvFilter;

/// The log goes to stderr.
#[derive(Debug, Args)]
pub(super) struct LogOptions {
    /// Form of the log: lines for people, or one JSON object a line.
    #[arg(long, env = "REALBEAM_LOG_FORMAT", default_value = "pretty")]
    log_format: LogFormat,
    /// What is logged: a level (error, warn, info, debug), or levels by module as in `server=debug,info`.
    #[arg(long, env = "RUST_LOG", default_value = "info")]
    log_filter: EnvFilter,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum LogFormat {
    Pretty,
    Json,
}

impl LogOptions {
    /// Logs from here on.
    pub(super) fn start(&self) {
        let log = tracing_subscriber::fmt().with_env_filter(self.log_filter.clone()).with_writer(stderr);
        match self.log_format {
            LogFormat::Pretty => log.with_ansi(stderr().is_terminal()).with_target(false).init(),
            LogFormat::Json => log.json().flatten_event(true).init(),
        }
    }
}
