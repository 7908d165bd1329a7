//! `realbeam-server serve`: what the service can be told.

use std::env;
use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, ensure};
use clap::Args;
use runtime::Threads;

use super::log::LogOptions;
use super::{cores, positive};
use crate::address::Address;
use crate::canary::Canary;
use crate::catalogue::WorkerOptions;
use crate::check::CheckOptions;
use crate::config::{
    ADMIN_TOKEN_VARIABLE, AdminOptions, Config, ConnectionLimits, RequestLimits, StopOptions, TOKEN_VARIABLE,
};
use crate::model::MAX_MODEL_BYTES;
use crate::serve::serve;
use crate::tls::TlsFiles;
use crate::token::Token;

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
    /// Bytes that a model's file may have; a larger one is not read.
    #[arg(long, env = "REALBEAM_MAX_MODEL_BYTES", default_value_t = MAX_MODEL_BYTES)]
    max_model_bytes: u64,
    /// Model that is used where a request names none.
    #[arg(long, env = "REALBEAM_DEFAULT_MODEL", default_value = "hdl64e")]
    default_model: String,
    /// Address to listen at, for HTTP and gRPC: an IP address and a port, 0 for a free one, or `unix:` and the path of a socket.
    #[arg(long, env = "REALBEAM_ADDR", default_value = "127.0.0.1:8080")]
    addr: Address,
    /// Permissions of that socket, in octal digits.
    #[arg(long, env = "REALBEAM_SOCKET_MODE", default_value = "600", value_name = "MODE", value_parser = socket_mode)]
    socket_mode: u32,
    /// Certificate by which the service is known, and those that vouch for it (PEM); connections are then TLS 1.2 or 1.3 [default: plain HTTP].
    #[arg(long, env = "REALBEAM_TLS_CERT", value_name = "FILE")]
    tls_cert: Option<PathBuf>,
    /// Its private key (PEM, not encrypted).
    #[arg(long, env = "REALBEAM_TLS_KEY", value_name = "FILE")]
    tls_key: Option<PathBuf>,
    /// File that holds the token which every request has to show as `Authorization: Bearer`, but for `GET /`, /v2/health/live and
    /// /v2/health/ready [default: none]. `REALBEAM_TOKEN` may hold it instead.
    #[arg(long, env = "REALBEAM_TOKEN_FILE", value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// OpenTelemetry collector that gets traces by OTLP over HTTP, as in `http://127.0.0.1:4318/v1/traces` [default: nobody]. Needs a program
    /// that was built with the feature `otlp`.
    #[arg(long, env = "REALBEAM_OTLP", value_name = "URL")]
    otlp: Option<String>,
    /// No page for people at `GET /`.
    #[arg(long, env = "REALBEAM_NO_UI", value_parser = clap::builder::BoolishValueParser::new())]
    no_ui: bool,
    /// Worker threads of each model, each with a session of its own.
    #[arg(long, env = "REALBEAM_WORKERS", default_value_t = 1, value_parser = positive)]
    workers: usize,
    /// Threads within an operator, for each worker [default: all cores].
    #[arg(long, env = "REALBEAM_THREADS", value_parser = positive)]
    threads: Option<usize>,
    /// Microseconds for which those threads spin while they wait for work in the middle of a run, before they sleep: more is faster where
    /// nothing else runs on this machine, slower where something does.
    #[arg(long, env = "REALBEAM_SPIN", value_name = "MICROSECONDS", default_value = "200", value_parser = microseconds)]
    spin: Duration,
    /// Scans of a model that a worker may take at once, to run them as one batch; answers are the same bytes. More scans a second where
    /// threads are many, and each waits for all of its batch.
    #[arg(long, env = "REALBEAM_BATCH", default_value_t = WorkerOptions::default().batch, value_parser = positive)]
    batch: usize,
    /// Scans that may wait while all workers have one, before others are turned away with 429; 0: nobody waits.
    #[arg(long, env = "REALBEAM_QUEUE", default_value_t = WorkerOptions::default().queue)]
    queue: usize,
    /// Share of the streams that gets a version; the others get the newest of the other versions. Once a model, several split by commas
    /// in the environment.
    #[arg(long, env = "REALBEAM_CANARY", value_name = "NAME=VERSION:SHARE", value_delimiter = ',')]
    canary: Vec<Canary>,
    /// Seconds between two looks at the folder for models that are new, changed or gone [default: it is not looked at].
    #[arg(long, env = "REALBEAM_POLL", value_name = "SECONDS", value_parser = poll_seconds)]
    poll: Option<Duration>,
    /// Loopback address at which models are loaded and unloaded, by whoever has the token [default: nowhere]. The token is what
    /// `REALBEAM_ADMIN_TOKEN` holds, or the file below.
    #[arg(long, env = "REALBEAM_ADMIN", value_name = "ADDR")]
    admin: Option<SocketAddr>,
    /// File that holds the token.
    #[arg(long, env = "REALBEAM_ADMIN_TOKEN_FILE", value_name = "FILE")]
    admin_token_file: Option<PathBuf>,
    /// Bytes of address space that a process has for the check of a model before it is served.
    #[arg(long, env = "REALBEAM_CHECK_MEMORY_BYTES", default_value_t = CheckOptions::default().memory_bytes)]
    check_memory_bytes: u64,
    /// Seconds that the check may take.
    #[arg(long, env = "REALBEAM_CHECK_TIME_S", default_value = "60", value_parser = seconds)]
    check_time_s: Duration,
    /// Bytes that a body, or a message of gRPC, may have; more is 413, over gRPC `RESOURCE_EXHAUSTED`.
    #[arg(long, env = "REALBEAM_MAX_BODY_BYTES", default_value_t = RequestLimits::default().max_body_bytes)]
    max_body_bytes: usize,
    /// Points that a scan may have; more is 413.
    #[arg(long, env = "REALBEAM_MAX_POINTS", default_value_t = RequestLimits::default().max_points)]
    max_points: usize,
    /// Bytes that a compressed scan may unpack to, in each worker, beside those of bodies and answers; more is 413.
    #[arg(long, env = "REALBEAM_MAX_UNPACKED_BYTES", default_value_t = RequestLimits::default().max_unpacked_bytes)]
    max_unpacked_bytes: usize,
    /// Range images that a request for a generator alone may have; more is 422.
    #[arg(long, env = "REALBEAM_MAX_BATCH", default_value_t = RequestLimits::default().max_batch, value_parser = positive)]
    max_batch: usize,
    /// Bytes that all bodies and answers under way may have together; more is 429.
    #[arg(long, env = "REALBEAM_MAX_INFLIGHT_BYTES", default_value_t = RequestLimits::default().max_inflight_bytes)]
    max_inflight_bytes: usize,
    /// Seconds that a body gets to arrive; slower is 408.
    #[arg(long, env = "REALBEAM_BODY_TIME_S", default_value = "30", value_parser = seconds)]
    body_time_s: Duration,
    /// Connections at a time; one more is told 503 and closed.
    #[arg(long, env = "REALBEAM_MAX_CONNECTIONS", default_value_t = ConnectionLimits::default().max, value_parser = positive)]
    max_connections: usize,
    /// Seconds that a connection may be without a request, or take to send the headers of one, or a stream of scans
    /// without a scan; then it is closed.
    #[arg(long, env = "REALBEAM_IDLE_TIME_S", default_value = "60", value_parser = seconds)]
    idle_time_s: Duration,
    /// Seconds in which a client may take nothing of an answer that is there for it; then the connection is closed.
    #[arg(long, env = "REALBEAM_WRITE_TIME_S", default_value = "30", value_parser = seconds)]
    write_time_s: Duration,
    /// Seconds from the signal to stop in which requests are still taken while /v2/health/ready is 503, so that a load balancer can look
    /// away.
    #[arg(long, env = "REALBEAM_LAME_DUCK_S", default_value = "0", value_parser = seconds)]
    lame_duck_s: Duration,
    /// Seconds that requests under way get to finish after that.
    #[arg(long, env = "REALBEAM_GRACE_S", default_value = "30", value_parser = seconds)]
    grace_s: Duration,
}

impl Serve {
    /// Serves until the service is told to stop.
    pub(super) fn run(self) -> anyhow::Result<()> {
        self.log.start();
        if let Some(file) = &self.config {
            tracing::info!("configured by {}", file.display());
        }
        let mut config = self.into_config()?;
        config.check.program =
            Some(env::current_exe().context("cannot find the program that checks models: this one")?);
        let scheme = if config.tls.is_some() { "https" } else { "http" };
        let server = serve(&config)?;
        if let Some(addr) = server.admin_addr() {
            tracing::info!("models are loaded at http://{addr}");
        }
        match server.addr() {
            Address::Tcp(addr) => {
                if config.token.is_some() && config.tls.is_none() && !addr.ip().to_canonical().is_loopback() {
                    tracing::warn!("without --tls-cert and --tls-key the token can be read on its way");
                }
                tracing::info!("listening at {scheme}://{addr}");
            }
            socket @ Address::Unix(_) => tracing::info!("listening at {socket}"),
        }
        Ok(server.stop_at_signal()?)
    }

    fn into_config(self) -> anyhow::Result<Config> {
        let admin_token = || {
            let token = token(ADMIN_TOKEN_VARIABLE, "--admin-token-file", self.admin_token_file.as_deref())?;
            token.with_context(|| format!("--admin needs a token: either {ADMIN_TOKEN_VARIABLE} or --admin-token-file"))
        };
        let admin = self.admin.map(|addr| anyhow::Ok(AdminOptions { addr, token: admin_token()? })).transpose()?;
        ensure!(
            self.tls_cert.is_some() == self.tls_key.is_some(),
            "--tls-cert and --tls-key go together; one of them is missing"
        );
        Ok(Config {
            models: self.models,
            max_model_bytes: self.max_model_bytes,
            default_model: self.default_model,
            addr: self.addr,
            socket_mode: self.socket_mode,
            tls: self.tls_cert.zip(self.tls_key).map(|(cert, key)| TlsFiles { cert, key }),
            token: token(TOKEN_VARIABLE, "--token-file", self.token_file.as_deref())?,
            otlp: self.otlp,
            page: !self.no_ui,
            workers: WorkerOptions {
                workers: self.workers,
                threads: Threads { number: self.threads.unwrap_or_else(cores), spin: self.spin },
                batch: self.batch,
                queue: self.queue,
            },
            check: CheckOptions { program: None, memory_bytes: self.check_memory_bytes, time: self.check_time_s },
            canaries: self.canary,
            poll: self.poll,
            admin,
            requests: RequestLimits {
                max_body_bytes: self.max_body_bytes,
                max_points: self.max_points,
                max_unpacked_bytes: self.max_unpacked_bytes,
                max_batch: self.max_batch,
                max_inflight_bytes: self.max_inflight_bytes,
                body_time: self.body_time_s,
            },
            connections: ConnectionLimits {
                max: self.max_connections,
                idle_time: self.idle_time_s,
                write_time: self.write_time_s,
            },
            stop: StopOptions { lame_duck: self.lame_duck_s, grace: self.grace_s },
        })
    }
}

/// A token from its variable or its file; it is no option of its own, for the arguments of a process are for all to see.
fn token(variable: &str, option: &str, file: Option<&Path>) -> anyhow::Result<Option<Token>> {
    let text = env::var_os(variable);
    ensure!(text.is_none() || file.is_none(), "a token in {variable} and in {option}; expected one of them");
    let (text, origin) = match (text, file) {
        (None, None) => return Ok(None),
        // What is no text is no token either.
        (Some(text), _) => (text.into_string().unwrap_or_default(), variable.to_owned()),
        (None, Some(file)) => {
            let origin = format!("token file {}", file.display());
            (fs::read_to_string(file).with_context(|| origin.clone())?, origin)
        }
    };
    Ok(Some(Token::new(&text).with_context(|| origin)?))
}

/// A number that TOML has as `0o660` arrives in decimal digits; none of those gives the owner both of his permissions.
fn socket_mode(text: &str) -> Result<u32, String> {
    let mode = u32::from_str_radix(text, 8).ok().filter(|mode| *mode <= 0o777 && mode & 0o600 == 0o600);
    mode.ok_or_else(|| "expected octal digits such as 660, by which the owner may read and write".into())
}

fn poll_seconds(text: &str) -> Result<Duration, String> {
    seconds(text).and_then(|time| if time.is_zero() { Err("expected more than 0 seconds".into()) } else { Ok(time) })
}

fn microseconds(text: &str) -> Result<Duration, String> {
    let number = text.parse().ok().filter(|number| *number <= 1_000_000);
    number.map(Duration::from_micros).ok_or_else(|| "expected a whole number up to 1000000".into())
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    seconds.ok_or_else(|| "expected a number of seconds".into())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Alone {
        #[command(flatten)]
        serve: Serve,
    }

    #[test]
    fn a_socket_s_mode_is_octal_however_it_is_written() {
        assert_eq!((socket_mode("660"), socket_mode("0666"), socket_mode("0600")), (Ok(0o660), Ok(0o666), Ok(0o600)));
        let decimal = (0o600..=0o777).map(|mode| mode.to_string());
        for wrong in ["", "8", "060", "1777", "-600", "rw"].map(Into::into).into_iter().chain(decimal) {
            assert!(socket_mode(&wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn threads_spin_for_as_long_as_is_said() -> anyhow::Result<()> {
        let threads =
            |arguments: &[&str]| anyhow::Ok(Alone::parse_from(arguments).serve.into_config()?.workers.threads);
        assert_eq!(threads(&["serve", "--threads=3"])?, 3.into());
        let spin = Duration::from_micros(50);
        assert_eq!(threads(&["serve", "--threads=3", "--spin=50"])?, Threads { number: 3, spin });
        assert_eq!(threads(&["serve", "--threads=3", "--spin=0"])?, Threads { number: 3, spin: Duration::ZERO });
        assert!(Alone::try_parse_from(["serve", "--spin=2000000"]).is_err());
        Ok(())
    }

    #[test]
    fn who_says_nothing_gets_the_defaults_of_the_library() -> anyhow::Result<()> {
        let config = Alone::parse_from(["serve"]).serve.into_config()?;
        assert_eq!(format!("{config:?}"), format!("{:?}", Config::default()));
        Ok(())
    }
}
