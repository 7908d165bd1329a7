//! The admin listener: Triton's model-repository extension of the Open Inference Protocol, for whoever has the token.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{DefaultBodyLimit, Path, Request, State};
use axum::middleware;
use axum::routing::post;
use axum::{Json, Router};
use proto::ErrorCode;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use tower_http::catch_panic::CatchPanicLayer;

use super::error::ApiError;
use super::{App, bearer, body, envelope, other_method, panicked};
use crate::catalogue::{CatalogueError, Offer};
use crate::loader::Loader;
use crate::repository::RepositoryError;
use crate::token::Token;

/// Bytes that a body may have; the longest that means anything has fewer than a hundred.
const MAX_BODY_BYTES: usize = 4096;

/// What a body may say.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wish {
    /// Of the index, whether only what is served is listed.
    #[serde(default)]
    ready: bool,
    #[serde(default)]
    parameters: Map<String, Value>,
}

/// The listener's routes.
pub(crate) fn router(app: Arc<App>, loader: Arc<Loader>, token: Token) -> Router {
    let routes = Router::new()
        .route("/v2/repository/index", post(index))
        .route("/v2/repository/models/{model}/load", post(load))
        .route("/v2/repository/models/{model}/unload", post(unload))
        .fallback(no_such_route)
        .method_not_allowed_fallback(other_method)
        .with_state(loader)
        .layer(DefaultBodyLimit::max(MAX_BODY_BYTES));
    bearer::gated(routes, token, &[])
        .layer(CatchPanicLayer::custom(panicked))
        .layer(middleware::from_fn_with_state(app, envelope::envelope))
}

/// `POST /v2/repository/index`: every version in the folder or on offer.
async fn index(
    State(loader): State<Arc<Loader>>,
    body: Result<Bytes, BytesRejection>,
) -> Result<Json<Value>, ApiError> {
    let wish = Wish::read(body)?;
    let index = blocking(move || Ok(loader.index()?)).await?;
    let entries = index.into_iter().filter(|entry| entry.offer.is_ok() || !wish.ready).map(|entry| {
        let (state, reason) = match &entry.offer {
            Ok(_) => ("READY", ""),
            Err(reason) => ("UNAVAILABLE", reason.as_str()),
        };
        json!({ "name": entry.name, "version": entry.version.to_string(), "state": state, "reason": reason })
    });
    Ok(Json(entries.collect()))
}

/// `POST /v2/repository/models/{model}/load`: the model as it lies in the folder now, or why not. Answers once it is served.
async fn load(
    State(loader): State<Arc<Loader>>,
    Path(name): Path<String>,
    body: Result<Bytes, BytesRejection>,
) -> Result<Json<Value>, ApiError> {
    let wish = Wish::read(body)?;
    if !wish.parameters.is_empty() {
        let message =
            "`parameters` are not supported: models are loaded from the service's folder, and have no configuration";
        return Err(ApiError::new(ErrorCode::BadBody, message));
    }
    let named = name.clone();
    let offers = blocking(move || loader.load(&named)).await?;
    let version = |offer: &Arc<Offer>| json!({ "version": offer.version.to_string(), "digest": format!("sha256:{}", offer.model.digest) });
    Ok(Json(json!({ "name": name, "versions": offers.iter().map(version).collect::<Vec<_>>() })))
}

/// `POST /v2/repository/models/{model}/unload`: requests under way are answered, later ones find no such model.
async fn unload(
    State(loader): State<Arc<Loader>>,
    Path(name): Path<String>,
    body: Result<Bytes, BytesRejection>,
) -> Result<Json<Value>, ApiError> {
    // What Triton's clients say here is about ensembles, which there are none of.
    Wish::read(body)?;
    let named = name.clone();
    if blocking(move || Ok(loader.unload(&named))).await? {
        return Ok(Json(json!({ "name": name })));
    }
    Err(ApiError::new(ErrorCode::ModelNotFound, "no such model is loaded"))
}

async fn no_such_route(request: Request) -> ApiError {
    body::discard(request.into_body()).await;
    let routes =
        "POST /v2/repository/index, POST /v2/repository/models/{model}/load, POST /v2/repository/models/{model}/unload";
    ApiError::new(ErrorCode::RouteNotFound, format!("no such route; there are {routes}"))
}

/// Does what takes its time on a thread that may. Whoever may ask here may also know all that went wrong.
async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, CatalogueError> + Send + 'static,
) -> Result<T, ApiError> {
    let done = tokio::task::spawn_blocking(work).await;
    done.map_err(|error| ApiError::hidden(ErrorCode::Internal, &error))?.map_err(|error| match error {
        CatalogueError::Repository(RepositoryError::UnknownName { .. }) => {
            ApiError::new(ErrorCode::ModelNotFound, error.to_string())
        }
        error => ApiError::new(ErrorCode::ModelRefused, error.to_string()),
    })
}

impl Wish {
    /// Reads a body; an empty one says nothing.
    fn read(body: Result<Bytes, BytesRejection>) -> Result<Self, ApiError> {
        let body = body.map_err(|error| ApiError::new(ErrorCode::BadBody, error.body_text()))?;
        if body.is_empty() {
            return Ok(Self::default());
        }
        serde_json::from_slice(&body).map_err(|error| ApiError::new(ErrorCode::BadBody, format!("body: {error}")))
    }
}
