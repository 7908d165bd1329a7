//! What every answer gets: a request id, a line in the log, its place in the metrics, and, if it is an error, its JSON body or its
//! status of gRPC.

use std::hash::{BuildHasher, RandomState};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock};
use std::time::Instant;

use axum::Json;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderName, HeaderValue, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use proto::{ErrorBody, ErrorCode};

use super::error::ApiError;
use super::{App, grpc};
use crate::stopwatch::StageTimes;
use crate::traces::Answered;

/// Header of a request's id, in both directions.
pub(crate) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Longest id that is taken over from a client.
const MAX_ID_LENGTH: usize = 128;

/// A request's id, for those who answer it.
#[derive(Clone, Debug)]
pub(crate) struct RequestId(pub(crate) String);

/// Runs the request and wraps its answer.
pub(crate) async fn envelope(State(app): State<Arc<App>>, mut request: Request, next: Next) -> Response {
    let started = Instant::now();
    let id = taken_over(&request).unwrap_or_else(new_id);
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    // Routes are few; what is asked for besides may be anything.
    let route = request.extensions().get::<MatchedPath>().map_or("none", MatchedPath::as_str).to_owned();
    request.extensions_mut().insert(RequestId(id.clone()));
    let is_grpc = grpc::is_asked_for(request.headers());
    let parent = request.headers().get("traceparent").cloned();
    let mut response = next.run(request).await;
    let error = response.extensions_mut().remove::<ApiError>();
    let stages = response.extensions_mut().remove::<StageTimes>();
    if let Some(error) = &error {
        app.failed(error, &id);
        response = if is_grpc { grpc::refusal(error) } else { with_body(&response, error, &id) };
    }
    // An id is made of visible ASCII.
    if let Ok(value) = HeaderValue::from_str(&id) {
        response.headers_mut().insert(REQUEST_ID, value);
    }
    let status = if is_grpc { grpc::status(error.as_ref()).1.into() } else { response.status().as_u16().to_string() };
    let elapsed = started.elapsed();
    app.metrics.answered(&route, &status, elapsed);
    app.traces.add(&Answered {
        method: method.as_str(),
        route: &route,
        request_id: &id,
        status: &status,
        is_grpc,
        has_failed: error.is_some_and(|error| error.code.status() >= 500),
        time: elapsed,
        stages: stages.as_ref(),
        parent: parent.as_ref(),
    });
    let elapsed_ms = (elapsed.as_secs_f64() * 1e6).round() / 1e3;
    tracing::info!(request_id = id, %method, path, status, elapsed_ms, "answered");
    response
}

/// The error's JSON, with the headers that the answer has already (`Allow`).
fn with_body(bare: &Response, error: &ApiError, request_id: &str) -> Response {
    let body = ErrorBody { error: error.message.clone(), code: error.code, request_id: request_id.into() };
    let mut response = (bare.status(), Json(body)).into_response();
    if let Some(allow) = bare.headers().get(header::ALLOW) {
        response.headers_mut().insert(header::ALLOW, allow.clone());
    }
    if error.code == ErrorCode::Unauthorized {
        response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
    }
    if matches!(error.code, ErrorCode::Overloaded | ErrorCode::TooManyBytes | ErrorCode::NotReady) {
        response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from_static("1"));
    }
    response
}

/// The client's own id, if it is short and plain.
fn taken_over(request: &Request) -> Option<String> {
    let id = request.headers().get(REQUEST_ID)?.to_str().ok()?;
    let plain = !id.is_empty() && id.len() <= MAX_ID_LENGTH && id.bytes().all(|b| b.is_ascii_graphic());
    plain.then(|| id.to_owned())
}

/// An id that no other request of this process has, nor, in all likelihood, of any other.
fn new_id() -> String {
    static PROCESS: LazyLock<u64> = LazyLock::new(|| RandomState::new().hash_one(std::process::id()));
    static NUMBER: AtomicU64 = AtomicU64::new(1);
    format!("{:016x}-{}", *PROCESS, NUMBER.fetch_add(1, Ordering::Relaxed))
}
