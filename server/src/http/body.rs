//! Bodies of requests: read within a limit, or thrown away.

use std::future::poll_fn;
use std::pin::Pin;
use std::time::Duration;

use axum::body::{Body, Bytes, HttpBody};
use axum::http::{HeaderMap, header};
use proto::ErrorCode;

use super::error::ApiError;

/// Time that a client gets to send the rest of a body that nobody will read.
const DISCARD: Duration = Duration::from_secs(5);

/// Reads a body of at most `limit` bytes. One that announces more is refused before it is read.
pub(super) async fn read(headers: &HeaderMap, mut body: Body, limit: usize) -> Result<Bytes, ApiError> {
    let too_large = || ApiError::new(ErrorCode::BodyTooLarge, format!("the body has more than {limit} bytes"));
    let announced = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse::<u64>().ok());
    if announced.is_some_and(|bytes| bytes > limit as u64) {
        discard(body).await;
        return Err(too_large());
    }
    let mut bytes = Vec::with_capacity(announced.unwrap_or_default() as usize);
    while let Some(data) = next(&mut body).await {
        let data = data.map_err(|_| ApiError::new(ErrorCode::BadBody, "the body did not arrive in full"))?;
        if data.len() > limit - bytes.len() {
            discard(body).await;
            return Err(too_large());
        }
        bytes.extend_from_slice(&data);
    }
    Ok(bytes.into())
}

/// Reads a body to its end, for a while, and forgets it. A client that still sends when the connection closes would see a broken pipe
/// instead of the answer.
pub(super) async fn discard(mut body: Body) {
    let rest = async { while let Some(Ok(_)) = next(&mut body).await {} };
    // Whoever is slower than this has to do without.
    let _ = tokio::time::timeout(DISCARD, rest).await;
}

/// The next piece of a body; `None` at its end.
async fn next(body: &mut Body) -> Option<Result<Bytes, axum::Error>> {
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
