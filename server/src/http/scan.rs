//! `POST /v1/scan`: a simulated scan in, a realistic one out.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::rejection::{BytesRejection, QueryRejection};
use axum::extract::{FromRequest, Query, Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::Response;
use lidar::formats::Limits;
use lidar::label::CarlaTags;
use proto::{ErrorCode, MediaType};

use super::App;
use super::answer::{self, Served};
use super::error::ApiError;
use super::query::ScanQuery;
use crate::pipeline::ScanJob;

/// The handler. What can be refused by the head of the request is refused before its body is read.
pub(crate) async fn scan(
    State(app): State<Arc<App>>,
    query: Result<Query<Vec<(String, String)>>, QueryRejection>,
    request: Request,
) -> Result<Response, ApiError> {
    let Query(pairs) = query.map_err(|error| ApiError::new(ErrorCode::BadQuery, error.body_text()))?;
    let query = ScanQuery::parse(&pairs)?;
    let (content, accepted) = media_types(request.headers())?;
    let offer = app.catalogue.find(query.model.as_deref(), query.version)?;
    check_length(request.headers(), app.max_body_bytes)?;

    let pool = app.catalogue.pool(offer).await?;
    let bytes = Bytes::from_request(request, &()).await.map_err(|error| body_error(&error, app.max_body_bytes))?;
    let job = ScanJob {
        bytes,
        format: content.format,
        answer_format: accepted.format,
        frame: query.frame.unwrap_or(content.frame),
        seed: query.seed,
        limits: Limits { max_points: app.max_points, carla_tags: query.tags.unwrap_or(CarlaTags::Since0914) },
    };
    let done = pool.run(job).await?;
    let served = Served { model: &offer.model, version: offer.version, media: accepted, seed: query.seed };
    Ok(answer::response(done.output?, done.queued_for, &served))
}

/// Type of the body, and of the answer.
fn media_types(headers: &HeaderMap) -> Result<(MediaType, MediaType), ApiError> {
    let text = |name: header::HeaderName, code| match headers.get(&name).map(|value| value.to_str()) {
        None => Ok(None),
        Some(Ok(text)) => Ok(Some(text)),
        Some(Err(_)) => Err(ApiError::new(code, format!("header {name} is not plain ASCII"))),
    };
    let encoding = text(header::CONTENT_ENCODING, ErrorCode::UnsupportedEncoding)?;
    if let Some(encoding) = encoding.filter(|encoding| !encoding.eq_ignore_ascii_case("identity")) {
        let message = format!("content encoding `{encoding}` is not known; send the bytes as they are");
        return Err(ApiError::new(ErrorCode::UnsupportedEncoding, message));
    }
    let content = MediaType::of_content(text(header::CONTENT_TYPE, ErrorCode::UnsupportedMediaType)?)
        .map_err(|error| ApiError::new(ErrorCode::UnsupportedMediaType, error.to_string()))?;
    // `Accept` may come in several lines, which mean the same as one with commas.
    let mut accept = Vec::new();
    for line in headers.get_all(header::ACCEPT) {
        let plain = line.to_str();
        accept.push(plain.map_err(|_| ApiError::new(ErrorCode::NotAcceptable, "header accept is not plain ASCII"))?);
    }
    let accepted = content
        .negotiate(Some(&accept.join(",")))
        .map_err(|error| ApiError::new(ErrorCode::NotAcceptable, error.to_string()))?;
    Ok((content, accepted))
}

/// Refuses a body that announces too many bytes before the first one is read.
fn check_length(headers: &HeaderMap, limit: usize) -> Result<(), ApiError> {
    let announced = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse::<u64>().ok());
    if announced.is_some_and(|bytes| bytes > limit as u64) { Err(too_large(limit)) } else { Ok(()) }
}

fn body_error(error: &BytesRejection, limit: usize) -> ApiError {
    if error.status() == StatusCode::PAYLOAD_TOO_LARGE {
        return too_large(limit);
    }
    ApiError::new(ErrorCode::BadBody, "the body did not arrive in full")
}

fn too_large(limit: usize) -> ApiError {
    ApiError::new(ErrorCode::BodyTooLarge, format!("the body has more than {limit} bytes"))
}
