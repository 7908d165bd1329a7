//! How often a model was asked, and how long its stages took.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use serde_json::{Value, json};

use super::super::App;
use super::super::error::ApiError;
use super::named::InPath;
use crate::catalogue::Offer;
use crate::statistics::Sum;

/// `GET /v2/models/stats`: of every model.
pub(super) async fn all(State(app): State<Arc<App>>) -> Json<Value> {
    let models = app.catalogue.models();
    let offers = models.values().flat_map(BTreeMap::values);
    Json(json!({ "model_stats": offers.map(|offer| of_offer(offer)).collect::<Vec<_>>() }))
}

/// `GET /v2/models/{model}/stats`: of one.
pub(super) async fn of_model(State(app): State<Arc<App>>, path: InPath) -> Result<Json<Value>, ApiError> {
    let model = path.find(&app)?;
    Ok(Json(json!({ "model_stats": [of_offer(&model.offer)] })))
}

fn of_offer(offer: &Offer) -> Value {
    let totals = offer.statistics.totals();
    let sum = |sum: Sum| json!({ "count": sum.count, "ns": sum.time.as_nanos() as u64 });
    json!({
        "name": offer.model.name,
        "version": offer.version.to_string(),
        "last_inference": totals.last_ms,
        "inference_count": totals.success.count,
        "execution_count": totals.success.count,
        "inference_stats": {
            "success": sum(totals.success),
            "fail": sum(totals.fail),
            "queue": sum(totals.queue),
            "compute_input": sum(totals.before),
            "compute_infer": sum(totals.infer),
            "compute_output": sum(totals.after),
        },
        "batch_stats": [],
    })
}
