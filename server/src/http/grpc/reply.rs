//! The answer to a call: messages, then trailers that say how it ended.

use std::convert::Infallible;
use std::fmt::Write;
use std::pin::Pin;
use std::task::{Context, Poll};

use axum::body::{Body, Bytes, HttpBody};
use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::response::Response;
use hyper::body::Frame;
use prost::Message;
use tokio::sync::mpsc;

use super::super::error::ApiError;
use super::CONTENT_TYPE;
use super::messages::PREFIX;

/// Bytes of an answer that are ready, and at last its trailers.
pub(super) type Frames = mpsc::Sender<Frame<Bytes>>;

/// A body made of what is sent to it.
struct Sent(mpsc::Receiver<Frame<Bytes>>);

impl HttpBody for Sent {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        self.0.poll_recv(context).map(|frame| frame.map(Ok))
    }
}

/// The answer that goes on until the frames' sender is dropped.
pub(super) fn streaming() -> (Frames, Response) {
    let (frames, sent) = mpsc::channel(2);
    (frames, with_type(Response::new(Body::new(Sent(sent)))))
}

/// The answer that is one message, with its [prefix](framed).
pub(super) fn one(message: Bytes) -> Response {
    let (frames, response) = streaming();
    for frame in [Frame::data(message), Frame::trailers(trailers(None))] {
        // There is room for two.
        let _ = frames.try_send(frame);
    }
    response
}

/// The answer to a call that fails before it has an answer.
pub(in crate::http) fn refusal(error: &ApiError) -> Response {
    let mut response = with_type(Response::new(Body::empty()));
    response.headers_mut().extend(trailers(Some(error)));
    response
}

/// A message as it travels.
pub(super) fn framed(message: &impl Message) -> Vec<u8> {
    framed_before(message, 0)
}

/// The beginning of a message of which the last `following` bytes come by themselves.
fn framed_before(message: &impl Message, following: usize) -> Vec<u8> {
    let length = message.encoded_len() + following;
    let mut bytes = Vec::with_capacity(PREFIX + length - following);
    bytes.push(0);
    // No message is as long as 4 GiB: its tensors or points lie in memory, and have come by messages that are shorter.
    bytes.extend(u32::try_from(length).unwrap_or(u32::MAX).to_be_bytes());
    bytes.extend(message.encode_to_vec());
    bytes
}

/// A message with a last field of bytes that are not copied: number `field`, which the message itself leaves empty.
pub(super) fn framed_with(message: &impl Message, field: u8, data: Bytes) -> [Bytes; 2] {
    let mut head = vec![field << 3 | 2];
    let length = data.len();
    head.reserve(prost::length_delimiter_len(length));
    // A vector grows as it has to.
    let _ = prost::encode_length_delimiter(length, &mut head);
    let mut bytes = framed_before(message, head.len() + length);
    bytes.extend(head);
    [bytes.into(), data]
}

/// Number and name of the status that a call or a scan ends with.
pub(in crate::http) fn status(error: Option<&ApiError>) -> (u8, &'static str) {
    error.map_or((0, "OK"), |error| error.code.grpc_status())
}

/// How a call ends:
///
/// | trailer | meaning |
/// |---|---|
/// | `grpc-status` | number of the status |
/// | `grpc-message` | what went wrong, for a person |
/// | `x-realbeam-error` | what went wrong, for a program: the `code` of HTTP's errors |
pub(super) fn trailers(error: Option<&ApiError>) -> HeaderMap {
    let mut trailers = HeaderMap::new();
    trailers.insert(HeaderName::from_static("grpc-status"), u16::from(status(error).0).into());
    let Some(error) = error else { return trailers };
    let texts = [("grpc-message", percent_encoded(&error.message)), ("x-realbeam-error", error.code.name())];
    for (name, text) in texts {
        // Both are plain ASCII.
        if let Ok(value) = HeaderValue::try_from(text) {
            trailers.insert(HeaderName::from_static(name), value);
        }
    }
    trailers
}

fn percent_encoded(text: &str) -> String {
    let mut encoded = String::with_capacity(text.len());
    for byte in text.bytes() {
        if matches!(byte, b' '..=b'~') && byte != b'%' {
            encoded.push(byte as char);
        } else {
            // Writing to a string cannot fail.
            let _ = write!(encoded, "%{byte:02X}");
        }
    }
    encoded
}

fn with_type(mut response: Response) -> Response {
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(CONTENT_TYPE));
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_travel_as_plain_ascii() {
        assert_eq!(percent_encoded("90 % of ±1\n"), "90 %25 of %C2%B11%0A");
    }
}
