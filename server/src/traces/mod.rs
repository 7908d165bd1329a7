//! Traces: each request that has been answered, and the stages of a scan's way within it, for an OpenTelemetry collector.
//!
//! Only with the feature `otlp`; without it nothing is sent, and whoever asks for it is told so.

#[cfg(feature = "otlp")]
mod export;

use std::time::Duration;

use axum::http::HeaderValue;
use thiserror::Error;

use crate::stopwatch::StageTimes;

/// Where traces go, if anywhere.
#[derive(Debug)]
pub(crate) struct Traces {
    #[cfg(feature = "otlp")]
    export: Option<export::Export>,
}

/// Traces that cannot be sent.
#[derive(Debug, Error)]
pub enum TracesError {
    /// The program cannot do it.
    #[error("no traces can be sent to {0}: this program was built without the feature `otlp`")]
    Missing(String),
    /// The collector's address is none.
    #[error("no traces can be sent to {url}: {reason}")]
    Exporter {
        /// The address.
        url: String,
        /// What is wrong with it.
        reason: String,
    },
}

/// A request that has been answered just now.
#[cfg_attr(not(feature = "otlp"), expect(dead_code, reason = "only the export reads it"))]
pub(crate) struct Answered<'a> {
    pub(crate) method: &'a str,
    pub(crate) route: &'a str,
    pub(crate) request_id: &'a str,
    /// Of HTTP or gRPC.
    pub(crate) status: &'a str,
    pub(crate) is_grpc: bool,
    /// The answer is one for which the service is to blame.
    pub(crate) has_failed: bool,
    /// Time from the request's head to its answer's.
    pub(crate) time: Duration,
    /// Of work that got through.
    pub(crate) stages: Option<&'a StageTimes>,
    /// The client's own span: its header `traceparent` (W3C Trace Context).
    pub(crate) parent: Option<&'a HeaderValue>,
}

#[cfg(feature = "otlp")]
impl Traces {
    /// Traces for the collector at this address, or for nobody. Not to be called on an async thread.
    pub(crate) fn new(url: Option<&str>) -> Result<Self, TracesError> {
        Ok(Self { export: url.map(export::Export::new).transpose()? })
    }

    /// Adds a request.
    pub(crate) fn add(&self, answered: &Answered<'_>) {
        if let Some(export) = &self.export {
            export.add(answered);
        }
    }

    /// Sends what has not been sent yet; for a few seconds at most. Not to be called on an async thread.
    pub(crate) fn end(&self) {
        if let Some(export) = &self.export {
            export.end();
        }
    }
}

#[cfg(not(feature = "otlp"))]
#[expect(clippy::unused_self, reason = "the same face as with the feature")]
impl Traces {
    /// Traces for nobody.
    pub(crate) fn new(url: Option<&str>) -> Result<Self, TracesError> {
        url.map_or(Ok(Self {}), |url| Err(TracesError::Missing(url.into())))
    }

    /// Does nothing.
    pub(crate) fn add(&self, _: &Answered<'_>) {}

    /// Does nothing.
    pub(crate) fn end(&self) {}
}
