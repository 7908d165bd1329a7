//! The Open Inference Protocol, version 2, over HTTP: each generator under its own name, and the whole pipeline as the model `scan`.
//!
//! | model | inputs | outputs |
//! |---|---|---|
//! | a generator | `scan`, and `noise` where it has that | `range`, `reflectance`, `keep`; all `[batch, channel, ring, column]` |
//! | `scan` | `POINTS` `[-1, 4]`: x, y, z in m, intensity 0–1 | `POINTS` `[-1, 4]` |

mod ask;
mod describe;
mod infer;
mod named;
mod statistics;

use std::sync::Arc;

use axum::Router;
use axum::routing::{get, post};

use super::App;
pub(super) use ask::{Ask, Given};
pub(super) use describe::{Metadata, SERVER, is_ready};
pub(super) use named::InPath;

/// The protocol's routes.
pub(super) fn router() -> Router<Arc<App>> {
    let routes = Router::new()
        .route("/v2", get(describe::server))
        .route("/v2/health/live", get(describe::live))
        .route("/v2/health/ready", get(describe::ready))
        .route("/v2/models/stats", get(statistics::all));
    ["/v2/models/{model}", "/v2/models/{model}/versions/{version}"].into_iter().fold(routes, |routes, model| {
        routes
            .route(model, get(describe::metadata))
            .route(&format!("{model}/ready"), get(describe::model_ready))
            .route(&format!("{model}/config"), get(describe::config))
            .route(&format!("{model}/stats"), get(statistics::of_model))
            .route(&format!("{model}/infer"), post(infer::infer))
    })
}
