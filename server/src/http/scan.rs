//! `POST /v1/scan`: a simulated scan in, a realistic one out.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::{Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use axum::response::Response;
use lidar::label::CarlaTags;
use proto::{AnswerType, ErrorCode, MediaType};

use super::error::ApiError;
use super::query::{self, ScanQuery};
use super::terms::Terms;
use super::{App, answer, body, ring_counts};
use crate::catalogue::Offer;
use crate::config::RequestLimits;
use crate::generator::Chance;
use crate::pipeline::ScanJob;

/// What is asked for, but for the scan itself.
pub(crate) struct Wish {
    pub(crate) query: ScanQuery,
    pub(crate) terms: Terms,
    pub(crate) seed: u64,
    /// Type of the body.
    pub(crate) content: MediaType,
    /// Type of the answer.
    pub(crate) accepted: AnswerType,
    /// Points of each ring.
    pub(crate) ring_counts: Option<Vec<u32>>,
    /// Model to ask.
    pub(crate) offer: Arc<Offer>,
}

/// The handler. What can be refused by the head of the request is refused before its body is looked at.
pub(crate) async fn scan(State(app): State<Arc<App>>, request: Request) -> Result<Response, ApiError> {
    let (head, body) = request.into_parts();
    let admitted = Wish::read(&app, &head).and_then(|wish| {
        let admitted = body::admit(&app, &head.headers, &wish.offer)?;
        Ok((wish, admitted))
    });
    let (wish, admitted) = match admitted {
        Ok(admitted) => admitted,
        Err(error) => {
            body::discard(body).await;
            return Err(error);
        }
    };
    let (bytes, share) = admitted.read(&app, &wish.terms, body).await?;
    let answer = app.scan(&wish, wish.terms.enter(&app.streams), bytes).await?;
    Ok(answer::response(answer, share, &wish))
}

impl Wish {
    fn read(app: &App, head: &Parts) -> Result<Self, ApiError> {
        let (query, terms) = (ScanQuery::parse(&query::pairs(&head.uri)?)?, Terms::read(&head.headers)?);
        let seed = terms.seed_with(query.seed)?;
        let (content, accepted) = media_types(&head.headers)?;
        let key = terms.canary_key(&head.extensions);
        let offer = app.catalogue.find(query.model.as_deref(), query.version, key)?;
        let ring_counts = ring_counts::read(&head.headers, &offer)?;
        Ok(Self { query, terms, seed, content, accepted, ring_counts, offer })
    }

    /// What a pipeline has to do with the scan.
    pub(super) fn job(&self, bytes: Bytes, limits: &RequestLimits) -> ScanJob {
        ScanJob {
            bytes,
            format: self.content.format,
            answer: self.accepted.form,
            frame: self.query.frame.unwrap_or(self.content.frame),
            ring_counts: self.ring_counts.clone(),
            chance: Chance { seed: self.seed, noise: self.query.noise },
            limits: limits.formats(self.query.tags.unwrap_or(CarlaTags::Since0914)),
        }
    }
}

/// Type of the body, and of the answer.
fn media_types(headers: &HeaderMap) -> Result<(MediaType, AnswerType), ApiError> {
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
    let content = text(header::CONTENT_TYPE, ErrorCode::UnsupportedMediaType)?;
    // `Accept` may come in several lines, which mean the same as one with commas.
    let mut accept = Vec::new();
    for line in headers.get_all(header::ACCEPT) {
        let plain = line.to_str();
        accept.push(plain.map_err(|_| ApiError::new(ErrorCode::NotAcceptable, "header accept is not plain ASCII"))?);
    }
    negotiated(content, &accept.join(","))
}

/// Type of a scan, and of its answer, by the words of the headers.
pub(super) fn negotiated(content: Option<&str>, accept: &str) -> Result<(MediaType, AnswerType), ApiError> {
    let content = MediaType::of_content(content)
        .map_err(|error| ApiError::new(ErrorCode::UnsupportedMediaType, error.to_string()))?;
    let accepted =
        content.negotiate(Some(accept)).map_err(|error| ApiError::new(ErrorCode::NotAcceptable, error.to_string()))?;
    Ok((content, accepted))
}
