//! `GET /sample`: a made-up street as a model's sensor would see it without noise or drop, for whoever has no scan at hand.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderValue, Uri, header};
use axum::response::{IntoResponse, Response};
use lidar::Sensor;
use lidar::formats::{self, Format, FormatError};
use proto::{ErrorCode, MediaType};
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, cast};
use tokio::sync::Mutex;

use super::error::ApiError;
use super::query::{self, ScanQuery};
use super::{App, page};

/// Seed of the street.
const STREET: u64 = 3;

/// The street as the sensor that was asked for last sees it. One is cast at a time.
#[derive(Clone, Debug, Default)]
pub(super) struct Street(Arc<Mutex<Option<(Sensor, Bytes)>>>);

impl Street {
    /// The handler: the scan as PLY, with rings and labels; `?model=` and `?version=` as for a scan.
    pub(super) async fn sample(self, State(app): State<Arc<App>>, uri: Uri) -> Result<Response, ApiError> {
        let query = ScanQuery::parse(&query::pairs(&uri)?)?;
        let sensor = app.catalogue.find(query.model.as_deref(), query.version, None)?.model.card.sensor.clone();
        let mut latest = self.0.lock_owned().await;
        // The lock goes along, so that whoever leaves meanwhile lets nobody else begin.
        let cast = tokio::task::spawn_blocking(move || match &*latest {
            Some((of, scan)) if *of == sensor => Ok(scan.clone()),
            _ => {
                let scan = Bytes::from(see(&sensor)?);
                *latest = Some((sensor, scan.clone()));
                Ok(scan)
            }
        });
        let failed = |error: &dyn ToString| ApiError::hidden(ErrorCode::Internal, &error.to_string());
        let scan = cast.await.map_err(|error| failed(&error))?.map_err(|error: FormatError| failed(&error))?;
        let content_type = HeaderValue::from_static(MediaType::of_format(Format::Ply).name);
        Ok(([(header::CONTENT_TYPE, content_type)], page::SAME_ORIGIN, scan).into_response())
    }
}

fn see(sensor: &Sensor) -> Result<Vec<u8>, FormatError> {
    let mut cloud = cast(&street(STREET, &StreetConfig::default()), sensor, &Pose::default(), &Motion::default()).cloud;
    // What most simulators do not give would only make it larger.
    cloud.extra.clear();
    cloud.time_s = None;
    formats::encode(Format::Ply, &cloud)
}
