//! gRPC over HTTP/2, on HTTP's own listener: the Open Inference Protocol and streams of scans.
//!
//! Messages are read here and not by a framework, for a share of the memory is taken by a message's announced length before it is read,
//! as with the bodies of HTTP. The protocol: <https://github.com/grpc/grpc>, `doc/PROTOCOL-HTTP2.md`.

mod messages;
mod open_inference;
mod reply;
mod scans;

use std::sync::Arc;

use axum::Router;
use axum::http::{HeaderMap, header};
use axum::routing::post;

use super::App;

pub(super) use reply::{refusal, status};

/// The type of what travels; clients may add `+proto`.
const CONTENT_TYPE: &str = "application/grpc";

/// The services' methods.
pub(super) fn router() -> Router<Arc<App>> {
    Router::new()
        .route("/inference.GRPCInferenceService/ServerLive", post(open_inference::server_live))
        .route("/inference.GRPCInferenceService/ServerReady", post(open_inference::server_ready))
        .route("/inference.GRPCInferenceService/ModelReady", post(open_inference::model_ready))
        .route("/inference.GRPCInferenceService/ServerMetadata", post(open_inference::server_metadata))
        .route("/inference.GRPCInferenceService/ModelMetadata", post(open_inference::model_metadata))
        .route("/inference.GRPCInferenceService/ModelInfer", post(open_inference::model_infer))
        .route(scans::ROUTE, post(scans::scan))
}

/// True if whoever asks speaks gRPC.
pub(super) fn is_asked_for(headers: &HeaderMap) -> bool {
    let kind = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok());
    kind.is_some_and(|kind| matches!(kind, CONTENT_TYPE | "application/grpc+proto"))
}
