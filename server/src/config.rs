//! What a service is started with.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

use lidar::formats;
use lidar::label::CarlaTags;

use crate::address::Address;
use crate::canary::Canary;
use crate::catalogue::WorkerOptions;
use crate::check::CheckOptions;
use crate::model::MAX_MODEL_BYTES;
use crate::tls::TlsFiles;
use crate::token::Token;

/// Environment variable that holds the token of the listener for scans.
pub const TOKEN_VARIABLE: &str = "REALBEAM_TOKEN";

/// Environment variable that holds the admin listener's token.
pub const ADMIN_TOKEN_VARIABLE: &str = "REALBEAM_ADMIN_TOKEN";

/// What a service is started with; the defaults are those of the command line.
#[derive(Clone, Debug)]
pub struct Config {
    /// The folder of models.
    pub models: PathBuf,
    /// Bytes that a model's file may have.
    pub max_model_bytes: u64,
    /// The model that is used where a request names none.
    pub default_model: String,
    /// Where to listen.
    pub addr: Address,
    /// Mode of the file, where that is a Unix-domain socket.
    pub socket_mode: u32,
    /// What the listener shows that it is who it is; `None` for plain HTTP.
    pub tls: Option<TlsFiles>,
    /// What every request has to show, but for the page and the two questions after the service's health; `None` for nothing.
    pub token: Option<Token>,
    /// Address of the OpenTelemetry collector that gets traces, by OTLP over HTTP: `http://127.0.0.1:4318/v1/traces`; `None` for nobody.
    pub otlp: Option<String>,
    /// Whether `GET /` is a page for people.
    pub page: bool,
    /// Workers of each model.
    pub workers: WorkerOptions,
    /// How models are checked before they are served.
    pub check: CheckOptions,
    /// Versions that only a share of the streams gets.
    pub canaries: Vec<Canary>,
    /// How often the folder is looked at for models that are new, changed or gone; `None` for never.
    pub poll: Option<Duration>,
    /// The listener through which models are loaded and unloaded; `None` for none.
    pub admin: Option<AdminOptions>,
    /// What a request may take.
    pub requests: RequestLimits,
    /// What a connection may take.
    pub connections: ConnectionLimits,
    /// How it ends.
    pub stop: StopOptions,
}

/// The listener through which models are loaded and unloaded.
#[derive(Clone, Debug)]
pub struct AdminOptions {
    /// Address to listen at, one that only this machine reaches; port 0 takes a free one.
    pub addr: SocketAddr,
    /// What every request has to show.
    pub token: Token,
}

/// What a request may take.
#[derive(Clone, Copy, Debug)]
pub struct RequestLimits {
    /// Bytes that a body may have.
    pub max_body_bytes: usize,
    /// Points that a scan may have.
    pub max_points: usize,
    /// Bytes that a compressed scan may unpack to, beside those of the bodies.
    pub max_unpacked_bytes: usize,
    /// Range images that a request for a generator alone may have.
    pub max_batch: usize,
    /// Bytes that the bodies and answers of all requests under way may have; at least `max_body_bytes`.
    pub max_inflight_bytes: usize,
    /// Time that a body gets to arrive.
    pub body_time: Duration,
}

/// What a connection may take.
#[derive(Clone, Copy, Debug)]
pub struct ConnectionLimits {
    /// Connections at a time.
    pub max: usize,
    /// Time without a request under way, that is to send the next one's headers or the first byte at all.
    pub idle_time: Duration,
    /// Time in which a client takes nothing of an answer that is there for it.
    pub write_time: Duration,
}

/// How a service ends.
#[derive(Clone, Copy, Debug)]
pub struct StopOptions {
    /// Time from the signal in which it still takes requests, but says that it is not ready, so that a load balancer can look away.
    pub lame_duck: Duration,
    /// Time that requests under way get to finish after that.
    pub grace: Duration,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            models: "models".into(),
            max_model_bytes: MAX_MODEL_BYTES,
            default_model: "hdl64e".into(),
            addr: Address::Tcp((Ipv4Addr::LOCALHOST, 8080).into()),
            socket_mode: 0o600,
            tls: None,
            token: None,
            otlp: None,
            page: true,
            workers: WorkerOptions::default(),
            check: CheckOptions::default(),
            canaries: Vec::new(),
            poll: None,
            admin: None,
            requests: RequestLimits::default(),
            connections: ConnectionLimits::default(),
            stop: StopOptions::default(),
        }
    }
}

impl RequestLimits {
    /// What a reader of scans accepts.
    pub(crate) fn formats(&self, carla_tags: CarlaTags) -> formats::Limits {
        let Self { max_points, max_unpacked_bytes, .. } = *self;
        formats::Limits { max_points, max_unpacked_bytes, carla_tags }
    }
}

impl Default for RequestLimits {
    fn default() -> Self {
        Self {
            max_body_bytes: 64 << 20,
            max_points: formats::Limits::default().max_points,
            max_unpacked_bytes: formats::Limits::default().max_unpacked_bytes,
            max_batch: 8,
            max_inflight_bytes: 256 << 20,
            body_time: Duration::from_secs(30),
        }
    }
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self { max: 512, idle_time: Duration::from_mins(1), write_time: Duration::from_secs(30) }
    }
}

impl Default for StopOptions {
    fn default() -> Self {
        Self { lame_duck: Duration::ZERO, grace: Duration::from_secs(30) }
    }
}
