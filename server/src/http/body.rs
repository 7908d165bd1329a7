//! Bodies of requests: let in, read within limits, or thrown away.

use std::future::poll_fn;
use std::pin::Pin;
use std::time::Duration;

use axum::body::{Body, Bytes, HttpBody};
use axum::http::{HeaderMap, header};
use proto::ErrorCode;

use super::App;
use super::error::ApiError;
use super::terms::{self, Terms};
use crate::budget::Share;
use crate::catalogue::Offer;

/// Time that a client gets to send the rest of a body that nobody will read.
const DISCARD: Duration = Duration::from_secs(5);

/// A body that has been let in but not read.
pub(super) struct Admitted {
    announced: Option<usize>,
    share: Share,
}

/// Lets a body in by its announced length, before it is read: if it is not too long, if its share of the memory is free, and if the
/// model's queue has room. A body of unknown length counts as the longest one.
pub(super) fn admit(app: &App, headers: &HeaderMap, offer: &Offer) -> Result<Admitted, ApiError> {
    let announced = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse::<u64>().ok());
    let limit = app.limits.max_body_bytes;
    if announced.is_some_and(|bytes| bytes > limit as u64) {
        return Err(too_large(limit));
    }
    if !offer.has_room() {
        return Err(ApiError::new(ErrorCode::Overloaded, "too many scans wait already; try again later"));
    }
    let announced = announced.map(|bytes| bytes as usize);
    let share = share(app, announced.unwrap_or(limit))?;
    Ok(Admitted { announced, share })
}

/// A share of the memory for so many bytes, if it is free.
pub(super) fn share(app: &App, bytes: usize) -> Result<Share, ApiError> {
    app.budget.take(bytes).ok_or_else(|| {
        let message = format!("bodies of {} bytes are under way already; try again later", app.budget.used());
        ApiError::new(ErrorCode::TooManyBytes, message)
    })
}

impl Admitted {
    /// Reads the body within its limits of bytes and time.
    pub(super) async fn read(self, app: &App, terms: &Terms, mut body: Body) -> Result<(Bytes, Share), ApiError> {
        let limit = app.limits.max_body_bytes;
        let mut bytes = Vec::with_capacity(self.announced.unwrap_or_default());
        let reading = async {
            while let Some(data) = next(&mut body).await {
                let data = data.map_err(|_| cut_short())?;
                if data.len() > limit - bytes.len() {
                    return Err(too_large(limit));
                }
                bytes.extend_from_slice(&data);
            }
            Ok(())
        };
        match in_time(app.limits.body_time, terms, reading).await {
            Ok(()) => {
                let mut share = self.share;
                share.resize(bytes.len());
                Ok((bytes.into(), share))
            }
            Err(error) => {
                discard_after(&error, body).await;
                Err(error)
            }
        }
    }
}

/// Reads, but not for longer than `time`, nor beyond the deadline.
pub(super) async fn in_time<T>(
    time: Duration,
    terms: &Terms,
    reading: impl Future<Output = Result<T, ApiError>>,
) -> Result<T, ApiError> {
    tokio::select! {
        read = reading => read,
        () = tokio::time::sleep(time) => {
            Err(ApiError::new(ErrorCode::BodyTooSlow, format!("the body did not arrive within {} s", time.as_secs_f64())))
        }
        () = terms::until(terms.deadline) => Err(terms::too_late()),
    }
}

/// As [`discard`], unless the rest of the body would come too late as well.
pub(super) async fn discard_after(error: &ApiError, body: Body) {
    if !matches!(error.code, ErrorCode::BodyTooSlow | ErrorCode::DeadlineExceeded) {
        discard(body).await;
    }
}

/// Reads a body to its end, for a while, and forgets it. A client that still sends when the connection closes would see a broken pipe
/// instead of the answer.
pub(super) async fn discard(mut body: Body) {
    let rest = async { while let Some(Ok(_)) = next(&mut body).await {} };
    // Whoever is slower than this has to do without.
    let _ = tokio::time::timeout(DISCARD, rest).await;
}

pub(super) fn too_large(limit: usize) -> ApiError {
    ApiError::new(ErrorCode::BodyTooLarge, format!("the body has more than {limit} bytes"))
}

/// The answer to a body that ended too early.
pub(super) fn cut_short() -> ApiError {
    ApiError::new(ErrorCode::BadBody, "the body did not arrive in full")
}

/// The next piece of a body; `None` at its end.
pub(super) async fn next(body: &mut Body) -> Option<Result<Bytes, axum::Error>> {
    loop {
        match poll_fn(|context| Pin::new(&mut *body).poll_frame(context)).await? {
            Ok(frame) => {
                // Trailers are no part of a scan.
                if let Ok(data) = frame.into_data() {
                    return Some(Ok(data));
                }
            }
            Err(error) => return Some(Err(error)),
        }
    }
}
