//! `x-ring-counts`: how many points each ring of the scan has.

use axum::http::HeaderMap;
use lidar::projection::ProjectionError;
use proto::ErrorCode;

use super::error::ApiError;
use super::terms;
use crate::catalogue::Offer;

const NAME: &str = "x-ring-counts";

/// The header's numbers, separated by commas, one for each of the model's rings from the highest to the lowest: CARLA's
/// `get_point_count(channel)` for channel 0, 1, … (its channel 0 looks highest). `None` without the header.
pub(super) fn read(headers: &HeaderMap, offer: &Offer) -> Result<Option<Vec<u32>>, ApiError> {
    let Some(text) = terms::text(headers, NAME)? else { return Ok(None) };
    // Before anything is kept of it.
    check(&format!("header {NAME}"), text.split(',').count(), offer)?;
    let count = |(place, text): (usize, &str)| {
        let wrong = || {
            let shown: String = text.chars().take(80).collect();
            let message = format!("header {NAME}: number {place} is `{shown}`, expected a whole number of points");
            ApiError::new(ErrorCode::BadHeader, message)
        };
        text.trim().parse().map_err(|_| wrong())
    };
    text.split(',').enumerate().map(count).collect::<Result<_, _>>().map(Some)
}

/// Refuses other numbers of rings than the model's, as `name` gives them.
pub(super) fn check(name: &str, found: usize, offer: &Offer) -> Result<(), ApiError> {
    let rings = offer.model.card.sensor.rings().len();
    if found == rings {
        return Ok(());
    }
    Err(ApiError::new(ErrorCode::UnusableScan, format!("{name}: {}", ProjectionError::OtherRings { found, rings })))
}
