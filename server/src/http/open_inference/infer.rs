//! `POST /v2/models/{model}/infer`: tensors in, tensors out.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use proto::open_inference::{HEADER_LENGTH, InferRequest};

use super::super::error::ApiError;
use super::super::query;
use super::super::terms::{self, Terms};
use super::super::{App, answer, body, ring_counts};
use super::ask::{Ask, Given};
use super::named::InPath;
use crate::pipeline::Pipeline;
use crate::stopwatch::Stopwatch;
use crate::worker::Caller;

/// The handler.
pub(super) async fn infer(State(app): State<Arc<App>>, path: InPath, request: Request) -> Result<Response, ApiError> {
    let (head, body) = request.into_parts();
    let admitted = read(&app, path, &head).and_then(|(ask, length)| {
        let admitted = body::admit(&app, &head.headers, &ask.model.offer)?;
        Ok((ask, length, admitted))
    });
    let (ask, length, admitted) = match admitted {
        Ok(admitted) => admitted,
        Err(error) => {
            body::discard(body).await;
            return Err(error);
        }
    };
    let (bytes, share) = admitted.read(&app, &ask.terms, body).await?;
    let (offer, terms, limits) = (Arc::clone(&ask.model.offer), ask.terms.clone(), app.limits);
    let work = move |pipeline: &mut Pipeline, caller: Caller<'_>| {
        let watch = Stopwatch::start();
        // A body without JSON is the points, and comes back as points alone but for the JSON that names them.
        let given = match length {
            Some(0) => Given::Points(bytes),
            length => Given::Tensors(InferRequest::parse(&bytes, length)?),
        };
        Ok(ask.run(given, watch, &limits, (pipeline, caller))?.encode(|answer| answer.to_bytes()))
    };
    let inferred = app.work(&offer, &terms, terms.enter(&app.streams), work).await?;
    let (bytes, header_length) = inferred.answer;
    let mut response = answer::on_its_way(bytes, share).into_response();
    response.extensions_mut().insert(inferred.times);
    let headers = response.headers_mut();
    let content_type = if header_length.is_some() { "application/octet-stream" } else { "application/json" };
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(content_type));
    if let Some(length) = header_length {
        headers.insert(HeaderName::from_static(HEADER_LENGTH), length.into());
    }
    Ok(response)
}

/// Everything that is known before the body has come, and how many of its bytes are JSON.
fn read(app: &App, path: InPath, head: &Parts) -> Result<(Ask, Option<usize>), ApiError> {
    let (query, headers) = (query::pairs(&head.uri)?, &head.headers);
    let generator = query.iter().find(|(key, _)| key == "model").map(|(_, name)| &**name);
    let terms = Terms::read(headers)?;
    let model = path.find_for(app, generator, terms.canary_key(&head.extensions))?;
    let ring_counts = if model.is_pipeline { ring_counts::read(headers, &model.offer)? } else { None };
    let length = terms::number(headers, HEADER_LENGTH)?;
    Ok((Ask { model, terms, query, ring_counts }, length))
}
