//! The model that a path names.

use std::collections::HashMap;
use std::sync::Arc;

use axum::extract::{FromRequestParts, Path};
use axum::http::request::Parts;
use proto::ErrorCode;

use super::super::App;
use super::super::error::ApiError;
use crate::catalogue::Offer;

/// Name of the pipeline among the models.
pub(in crate::http) const PIPELINE: &str = "scan";

/// Name of the pipeline's input and of its output.
pub(in crate::http) const POINTS: &str = "POINTS";

/// A model of the protocol.
#[derive(Debug)]
pub(in crate::http) struct Named {
    /// Its name there.
    pub(in crate::http) name: String,
    /// True for the pipeline, whose generator is the default model unless the query names another.
    pub(in crate::http) is_pipeline: bool,
    pub(in crate::http) offer: Arc<Offer>,
}

/// What the path says, or a message of gRPC in its place.
#[derive(Debug)]
pub(in crate::http) struct InPath {
    name: String,
    version: Option<u64>,
}

impl FromRequestParts<Arc<App>> for InPath {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &Arc<App>) -> Result<Self, ApiError> {
        let not_text = |error| ApiError::new(ErrorCode::ModelNotFound, format!("path: {error}"));
        let Path(mut segments) =
            Path::<HashMap<String, String>>::from_request_parts(parts, state).await.map_err(not_text)?;
        let name = segments.remove("model").unwrap_or_default();
        Self::new(name, segments.remove("version").as_deref())
    }
}

impl InPath {
    /// A model's name and, where it is given, its version.
    pub(in crate::http) fn new(name: String, version: Option<&str>) -> Result<Self, ApiError> {
        let version = version.map(|version| {
            let unknown =
                |_| ApiError::new(ErrorCode::ModelNotFound, format!("version `{version}` is no whole number"));
            version.parse().map_err(unknown)
        });
        Ok(Self { name, version: version.transpose()? })
    }

    /// The model, for a request that is about it.
    pub(in crate::http) fn find(self, app: &App) -> Result<Named, ApiError> {
        self.find_for(app, None, None)
    }

    /// The model, with `generator` in the pipeline, for a stream.
    pub(in crate::http) fn find_for(
        self,
        app: &App,
        generator: Option<&str>,
        stream: Option<&str>,
    ) -> Result<Named, ApiError> {
        let is_pipeline = self.name == PIPELINE;
        let generator = if is_pipeline { generator } else { Some(&*self.name) };
        let offer = app.catalogue.find(generator, self.version, stream)?;
        Ok(Named { name: self.name, is_pipeline, offer })
    }
}
