//! What the service and its models are, and whether they are ready.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use proto::ErrorCode;
use proto::open_inference::DATATYPE;
use serde_json::{Value, json};

use super::super::App;
use super::super::error::ApiError;
use super::named::{InPath, Named, POINTS};
use crate::onnx_file::Tensor;

/// Name and axes of an input or output; −1 is an axis of any length.
type Axes = (String, Vec<i64>);

/// `GET /v2`: name, version and what of the protocol's extensions there is.
pub(super) async fn server() -> Json<Value> {
    Json(json!({
        "name": "realbeam-server",
        "version": env!("CARGO_PKG_VERSION"),
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
pub(super) async fn metadata(State(app): State<Arc<App>>, path: InPath) -> Result<Json<Value>, ApiError> {
    let model = path.find(&app)?;
    let models = app.catalogue.models();
    let of_name = models.get(&model.offer.model.name);
    let versions: Vec<String> = of_name.into_iter().flat_map(BTreeMap::keys).map(u64::to_string).collect();
    let (inputs, outputs) = signature(&model);
    let tensor = |(name, axes): Axes| json!({ "name": name, "datatype": DATATYPE, "shape": axes });
    Ok(Json(json!({
        "name": model.name,
        "versions": versions,
        "platform": platform(&model),
        "inputs": inputs.into_iter().map(tensor).collect::<Vec<_>>(),
        "outputs": outputs.into_iter().map(tensor).collect::<Vec<_>>(),
    })))
}

/// `GET /v2/models/{model}/config`: the model's configuration in Triton's words.
pub(super) async fn config(State(app): State<Arc<App>>, path: InPath) -> Result<Json<Value>, ApiError> {
    let model = path.find(&app)?;
    let (inputs, outputs) = signature(&model);
    // Batches are an axis of the tensors like the others; nothing is batched across requests.
    let tensor = |(name, axes): Axes| json!({ "name": name, "data_type": format!("TYPE_{DATATYPE}"), "dims": axes });
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

fn require_ready(app: &App) -> Result<(), ApiError> {
    if app.is_ready() { Ok(()) } else { Err(ApiError::new(ErrorCode::NotReady, "the service is stopping")) }
}

fn platform(model: &Named) -> &'static str {
    if model.is_pipeline { "realbeam_pipeline" } else { "onnxruntime_onnx" }
}

/// Inputs and outputs.
fn signature(model: &Named) -> (Vec<Axes>, Vec<Axes>) {
    if model.is_pipeline {
        let points = vec![(POINTS.to_owned(), vec![-1, 4])];
        return (points.clone(), points);
    }
    let axes = |tensors: &[Tensor]| tensors.iter().map(|tensor| (tensor.name.clone(), tensor.dimensions())).collect();
    (axes(&model.offer.model.inputs), axes(&model.offer.model.outputs))
}
