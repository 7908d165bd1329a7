//! Health and model metadata, as the Open Inference Protocol has them.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Path, State};
use proto::ErrorCode;
use serde_json::{Value, json};

use super::App;
use super::error::ApiError;
use crate::onnx_file::Tensor;

/// `GET /v2/health/live`: the process answers.
pub(crate) async fn live() -> Json<Value> {
    Json(json!({ "live": true }))
}

/// `GET /v2/health/ready`: scans are taken.
pub(crate) async fn ready(State(app): State<Arc<App>>) -> Result<Json<Value>, ApiError> {
    if app.is_ready() {
        Ok(Json(json!({ "ready": true })))
    } else {
        Err(ApiError::new(ErrorCode::NotReady, "the service is stopping"))
    }
}

/// `GET /v2/models/{model}`: versions, and inputs and outputs of the newest one.
pub(crate) async fn metadata(State(app): State<Arc<App>>, Path(name): Path<String>) -> Result<Json<Value>, ApiError> {
    let newest = app.catalogue.find(Some(&name), None)?;
    let of_name = app.catalogue.models().find(|(other, _)| *other == name);
    let versions: Vec<String> =
        of_name.into_iter().flat_map(|(_, offers)| offers.map(|o| o.version.to_string())).collect();
    let tensors = |list: &[Tensor]| list.iter().map(tensor).collect::<Vec<_>>();
    Ok(Json(json!({
        "name": name,
        "versions": versions,
        "platform": "onnxruntime_onnx",
        "inputs": tensors(&newest.model.inputs),
        "outputs": tensors(&newest.model.outputs),
    })))
}

fn tensor(tensor: &Tensor) -> Value {
    json!({ "name": tensor.name, "datatype": "FP32", "shape": tensor.dimensions() })
}
