//! The HTTP face, and gRPC on it: routes, and what all of them share.

pub(crate) mod admin;
mod answer;
mod bearer;
mod body;
mod docs;
mod envelope;
mod error;
mod grpc;
mod info;
mod metrics;
mod open_inference;
mod openapi;
mod page;
mod query;
mod ring_counts;
mod sample;
mod scan;
mod terms;
mod work;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use axum::middleware;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use proto::ErrorCode;
use tokio_util::sync::CancellationToken;
use tower_http::catch_panic::CatchPanicLayer;

use crate::budget::Budget;
use crate::catalogue::Catalogue;
use crate::config::{Config, RequestLimits};
use crate::metrics::Metrics;
use crate::streams::Streams;
use crate::token::Token;
use crate::traces::Traces;
use error::ApiError;

/// What every handler works with.
#[derive(Debug)]
pub(crate) struct App {
    pub(crate) catalogue: Arc<Catalogue>,
    pub(crate) limits: RequestLimits,
    /// Memory for bodies and answers.
    pub(crate) budget: Budget,
    /// Streams of which only the latest scan counts.
    pub(crate) streams: Arc<Streams>,
    pub(crate) metrics: Metrics,
    pub(crate) traces: Traces,
    /// Time that a stream of scans may be without one.
    pub(crate) idle_time: Duration,
    /// Cancelled when nothing more is taken.
    pub(crate) end: CancellationToken,
    draining: AtomicBool,
}

impl App {
    pub(crate) fn new(
        catalogue: Arc<Catalogue>,
        (metrics, traces): (Metrics, Traces),
        config: &Config,
        end: CancellationToken,
    ) -> Self {
        let (limits, idle_time) = (config.requests, config.connections.idle_time);
        let budget = Budget::new(limits.max_inflight_bytes);
        Self {
            catalogue,
            limits,
            budget,
            streams: Arc::default(),
            metrics,
            traces,
            idle_time,
            end,
            draining: AtomicBool::new(false),
        }
    }

    pub(crate) fn is_ready(&self) -> bool {
        !self.draining.load(Ordering::Relaxed)
    }

    /// Writes down what is wrong with an answer, beside what the client is told.
    pub(crate) fn failed(&self, error: &ApiError, request_id: &str) {
        if error.code.is_rejection() {
            self.metrics.rejected(error.code.name());
        }
        if let Some(detail) = &error.detail {
            tracing::error!(request_id, detail, "failed");
        }
    }

    /// The service has been told to stop.
    pub(crate) fn drain(&self) {
        self.draining.store(true, Ordering::Relaxed);
    }
}

/// Routes that ask for no token: by these a load balancer sees whether the service lives, and a person gets the page that asks for it.
const OPEN: [&str; 3] = ["/", "/v2/health/live", "/v2/health/ready"];

/// The service's routes, with or without its page, for everybody or for whoever has the token.
pub(crate) fn router(app: Arc<App>, with_page: bool, token: Option<Token>) -> Router {
    let page = if with_page { page::router() } else { Router::new() };
    let routes = page
        .route("/v1/scan", post(scan::scan))
        .route("/info", get(info::info))
        .route("/metrics", get(metrics::metrics))
        .route("/api-doc/openapi.json", get(openapi::openapi))
        .route("/docs", get(docs::docs))
        .merge(open_inference::router())
        .merge(grpc::router())
        .fallback(no_such_route)
        .method_not_allowed_fallback(other_method)
        .with_state(Arc::clone(&app));
    let routes = match token {
        Some(token) => bearer::gated(routes, token, &OPEN),
        None => routes,
    };
    routes.layer(CatchPanicLayer::custom(panicked)).layer(middleware::from_fn_with_state(app, envelope::envelope))
}

async fn no_such_route(request: Request) -> ApiError {
    body::discard(request.into_body()).await;
    let routes = "POST /v1/scan, GET /v2/health/live, GET /v2/health/ready, GET /v2/models/{model}, GET /info, GET /metrics, GET /docs";
    ApiError::new(ErrorCode::RouteNotFound, format!("no such route; there are {routes}"))
}

async fn other_method(request: Request) -> ApiError {
    body::discard(request.into_body()).await;
    ApiError::new(ErrorCode::MethodNotAllowed, "this route does not take this method; see the Allow header")
}

// The signature is the layer's.
#[allow(clippy::needless_pass_by_value)]
fn panicked(panic: Box<dyn std::any::Any + Send>) -> Response {
    let said =
        panic.downcast_ref::<&str>().map(ToString::to_string).or_else(|| panic.downcast_ref::<String>().cloned());
    ApiError::hidden(ErrorCode::Internal, &format!("a handler panicked: {}", said.unwrap_or_default())).into_response()
}
