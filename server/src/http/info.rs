//! `GET /info`: what the service is, takes and offers.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use proto::card::Card;
use proto::media::{MEDIA_TYPES, MediaType};
use serde::Serialize;

use super::App;

/// The answer.
#[derive(Debug, Serialize)]
pub(crate) struct Info<'a> {
    service: &'static str,
    version: &'static str,
    default_model: &'a str,
    max_body_bytes: usize,
    max_points: usize,
    /// Types of scans, with the frame that each one is taken to be in.
    media_types: &'static [MediaType],
    models: Vec<ModelInfo<'a>>,
}

/// A model, as whoever names no version gets it, a canary's streams aside.
#[derive(Debug, Serialize)]
struct ModelInfo<'a> {
    name: &'a str,
    version: u64,
    /// All versions, oldest first.
    versions: Vec<u64>,
    digest: String,
    /// The whole card; `card.sensor.elevation_deg` lists the rings to simulate.
    card: &'a Card,
}

/// The handler.
pub(crate) async fn info(State(app): State<Arc<App>>) -> Json<serde_json::Value> {
    let offered = app.catalogue.models();
    // A model that is unloaded at this moment is left out.
    let chosen: Vec<_> = offered.keys().filter_map(|name| app.catalogue.find(Some(name), None, None).ok()).collect();
    let models = chosen.iter().map(|chosen| ModelInfo {
        name: &chosen.model.name,
        version: chosen.version,
        versions: offered.get(&chosen.model.name).into_iter().flat_map(BTreeMap::keys).copied().collect(),
        digest: format!("sha256:{}", chosen.model.digest),
        card: &chosen.model.card,
    });
    let info = Info {
        service: "realbeam-server",
        version: env!("CARGO_PKG_VERSION"),
        default_model: app.catalogue.default_model(),
        max_body_bytes: app.limits.max_body_bytes,
        max_points: app.limits.max_points,
        media_types: &MEDIA_TYPES,
        models: models.collect(),
    };
    Json(serde_json::to_value(info).unwrap_or_default())
}
