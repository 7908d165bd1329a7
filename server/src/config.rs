//! What a service is started with.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

use lidar::formats;

use crate::catalogue::WorkerOptions;

/// What a service is started with; the defaults are those of the command line.
#[derive(Clone, Debug)]
pub struct Config {
    /// The folder of models.
    pub models: PathBuf,
    /// The model that is used where a request names none.
    pub default_model: String,
    /// Address to listen at; port 0 takes a free one.
    pub addr: SocketAddr,
    /// Workers of each model.
    pub workers: WorkerOptions,
    /// What a request may take.
    pub requests: RequestLimits,
    /// What a connection may take.
    pub connections: ConnectionLimits,
    /// How it ends.
    pub stop: StopOptions,
}

/// What a request may take.
#[derive(Clone, Copy, Debug)]
pub struct RequestLimits {
    /// Bytes that a body may have.
    pub max_body_bytes: usize,
    /// Points that a scan may have.
    pub max_points: usize,
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
            default_model: "hdl64e".into(),
            addr: (Ipv4Addr::LOCALHOST, 8080).into(),
            workers: WorkerOptions::default(),
            requests: RequestLimits::default(),
            connections: ConnectionLimits::default(),
            stop: StopOptions::default(),
        }
    }
}

impl Default for RequestLimits {
    fn default() -> Self {
        Self {
            max_body_bytes: 64 << 20,
            max_points: formats::Limits::default().max_points,
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
