//! What the service and its models are, and whether they are ready.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use proto::ErrorCode;
use proto::open_inference::DATATYPE;
use serde::Serialize;
use serde_json::{Value, json};

use super::super::App;
use super::super::error::ApiError;
use super::named::{InPath, Named, POINTS};
use crate::onnx_file::Tensor;

/// Name and version of the service.
pub(in crate::http) const SERVER: (&str, &str) = ("realbeam-server", env!("CARGO_PKG_VERSION"));

/// What a model is.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Metadata {
    pub(in crate::http) name: String,
    pub(in crate::http) versions: Vec<String>,
    pub(in crate::http) platform: &'static str,
    pub(in crate::http) inputs: Vec<Axes>,
    pub(in crate::http) outputs: Vec<Axes>,
}

/// An input or output.
#[derive(Clone, Debug, Serialize)]
pub(in crate::http) struct Axes {
    pub(in crate::http) name: String,
    pub(in crate::http) datatype: &'static str,
    /// Lengths of its axes; −1 is any length.
    pub(in crate::http) shape: Vec<i64>,
}

impl Metadata {
    /// Describes a model on offer.
    pub(in crate::http) fn of(app: &App, model: Named) -> Self {
        let models = app.catalogue.models();
        let of_name = models.get(&model.offer.model.name);
        let versions = of_name.into_iter().flat_map(BTreeMap::keys).map(u64::to_string).collect();
        let (inputs, outputs) = signature(&model);
        Self { platform: platform(&model), name: model.name, versions, inputs, outputs }
    }
}

/// `GET /v2`: name, version and what of the protocol's extensions there is.
pub(super) async fn server() -> Json<Value> {
    Json(json!({
        "name": SERVER.0,
        "version": SERVER.1,
        "extensions": ["binary_tensor_data", "model_configuration", "statistics"],
    }))
}

/// `GET /v2/health/live`: the process answers.
pub(super) async fn live() -> Json<Value> {
    Json(json!({ "live": true }))
}

/// `GET /v2/health/ready`: scans are taken.
pub(super) async fn ready(State(app): State<Arc<App>>) -> Result<Json<Value>, ApiError> {
    require_ready(&app)?;
    Ok(Json(json!({ "ready": true })))
}

/// `GET /v2/models/{model}/ready`: the model takes scans.
pub(super) async fn model_ready(State(app): State<Arc<App>>, path: InPath) -> Result<Json<Value>, ApiError> {
    let model = path.find(&app)?;
    require_ready(&app)?;
    Ok(Json(json!({ "name": model.name, "ready": true })))
}

/// `GET /v2/models/{model}`: versions, inputs and outputs.
pub(super) async fn metadata(State(app): State<Arc<App>>, path: InPath) -> Result<Json<Metadata>, ApiError> {
    Ok(Json(Metadata::of(&app, path.find(&app)?)))
}

/// `GET /v2/models/{model}/config`: the model's configuration in Triton's words.
pub(super) async fn config(State(app): State<Arc<App>>, path: InPath) -> Result<Json<Value>, ApiError> {
    let model = path.find(&app)?;
    let (inputs, outputs) = signature(&model);
    // Batches are an axis of the tensors like the others; nothing is batched across requests.
    let tensor =
        |tensor: Axes| json!({ "name": tensor.name, "data_type": format!("TYPE_{DATATYPE}"), "dims": tensor.shape });
    Ok(Json(json!({
        "name": model.name,
        "platform": platform(&model),
        "backend": "onnxruntime",
        "max_batch_size": 0,
        "version_policy": { "all": {} },
        "input": inputs.into_iter().map(tensor).collect::<Vec<_>>(),
        "output": outputs.into_iter().map(tensor).collect::<Vec<_>>(),
        "instance_group": [{ "kind": "KIND_CPU", "count": app.catalogue.options().workers }],
    })))
}

/// True if the model is on offer and scans are taken.
pub(in crate::http) fn is_ready(app: &App, model: InPath) -> bool {
    app.is_ready() && model.find(app).is_ok()
}

fn require_ready(app: &App) -> Result<(), ApiError> {
    if app.is_ready() { Ok(()) } else { Err(ApiError::new(ErrorCode::NotReady, "the service is stopping")) }
}

fn platform(model: &Named) -> &'static str {
    if model.is_pipeline { "realbeam_pipeline" } else { "onnxruntime_onnx" }
}

/// Inputs and outputs.
fn signature(model: &Named) -> (Vec<Axes>, Vec<Axes>) {
    if model.is_pipeline {
        let points = vec![Axes { name: POINTS.into(), datatype: DATATYPE, shape: vec![-1, 4] }];
        return (points.clone(), points);
    }
    let of = |tensor: &Tensor| Axes { name: tensor.name.clone(), datatype: DATATYPE, shape: tensor.dimensions() };
    let axes = |tensors: &[Tensor]| tensors.iter().map(of).collect();
    (axes(&model.offer.model.inputs), axes(&model.offer.model.outputs))
}
