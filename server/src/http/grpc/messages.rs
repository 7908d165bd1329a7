//! The messages of a call, as they arrive.

use axum::body::{Body, Bytes};
use axum::extract::Request;
use axum::http::request::Parts;
use proto::ErrorCode;

use super::super::error::ApiError;
use super::super::terms::Terms;
use super::super::{App, body};
use super::is_asked_for;
use crate::budget::Share;

/// Bytes before each message: whether it is compressed, and its length.
pub(super) const PREFIX: usize = 5;

/// The messages of a call that are not read yet.
#[derive(Debug)]
pub(super) struct Messages {
    body: Body,
    /// What has arrived and is not read.
    arrived: Bytes,
}

/// The head of a call, and its messages.
pub(super) async fn call(request: Request) -> Result<(Parts, Messages), ApiError> {
    let (head, body) = request.into_parts();
    if is_asked_for(&head.headers) {
        return Ok((head, Messages { body, arrived: Bytes::new() }));
    }
    body::discard(body).await;
    Err(ApiError::new(ErrorCode::UnsupportedMediaType, "this route speaks gRPC: content type application/grpc"))
}

impl Messages {
    /// The only message of a call, and its share of the memory.
    pub(super) async fn only(mut self, app: &App, terms: &Terms) -> Result<(Bytes, Share), ApiError> {
        let limit = app.limits.max_body_bytes;
        let reading = async {
            let wrong = |found| ApiError::new(ErrorCode::BadBody, format!("the call has {found}, expected one"));
            let length = self.announced(limit).await?.ok_or_else(|| wrong("no message"))?;
            let share = body::share(app, length)?;
            let message = self.message(length).await?;
            if self.announced(limit).await?.is_some() { Err(wrong("several messages")) } else { Ok((message, share)) }
        };
        let read = body::in_time(app.limits.body_time, terms, reading).await;
        if let Err(error) = &read {
            body::discard_after(error, self.body).await;
        }
        read
    }

    /// The length of the next message; `None` after the last. One that is too long, or compressed, is an error.
    pub(super) async fn announced(&mut self, limit: usize) -> Result<Option<usize>, ApiError> {
        let mut prefix = Vec::with_capacity(PREFIX);
        self.read(&mut prefix, PREFIX).await?;
        match prefix[..] {
            [] => Ok(None),
            [0, a, b, c, d] => {
                let length = u32::from_be_bytes([a, b, c, d]) as usize;
                if length > limit { Err(body::too_large(limit)) } else { Ok(Some(length)) }
            }
            [_, _, _, _, _] => {
                let message = "compressed messages are not taken; send them as they are";
                Err(ApiError::new(ErrorCode::UnsupportedEncoding, message))
            }
            _ => Err(body::cut_short()),
        }
    }

    /// The message whose length has been announced.
    pub(super) async fn message(&mut self, length: usize) -> Result<Bytes, ApiError> {
        let mut message = Vec::with_capacity(length);
        self.read(&mut message, length).await?;
        if message.len() == length { Ok(message.into()) } else { Err(body::cut_short()) }
    }

    /// Reads until there are `wanted` bytes, or to the end.
    async fn read(&mut self, bytes: &mut Vec<u8>, wanted: usize) -> Result<(), ApiError> {
        while bytes.len() < wanted {
            if self.arrived.is_empty() {
                let Some(arrived) = body::next(&mut self.body).await else { return Ok(()) };
                self.arrived = arrived.map_err(|_| body::cut_short())?;
            }
            let own = self.arrived.split_to(self.arrived.len().min(wanted - bytes.len()));
            bytes.extend_from_slice(&own);
        }
        Ok(())
    }
}
