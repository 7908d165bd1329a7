//! The messages of the gRPC services, generated from the files in `protos/`, and their reading.
//!
//! A few bytes of a message may stand for many in memory: an empty input is two bytes, and a struct of some hundred. So whatever is not
//! the payload of a message has to be short, which is looked at before anything is made of it.

#[allow(missing_docs, clippy::all, clippy::pedantic)]
pub mod inference {
    //! The Open Inference Protocol.
    include!("grpc/inference.rs");
}

#[allow(missing_docs, clippy::all, clippy::pedantic)]
pub mod scans {
    //! Streams of scans.
    include!("grpc/realbeam.v1.rs");
}

use bytes::Bytes;
use thiserror::Error;

/// Bytes that a message may have beside its payload.
pub const MAX_BESIDE_PAYLOAD: usize = 64 << 10;

/// A message that services receive.
pub trait Received: prost::Message + Default {
    /// Fields that are no longer in memory than on the wire, each by the numbers on the way to it.
    const PAYLOAD: &'static [&'static [u64]] = &[];
}

/// Bytes that are no message.
#[derive(Clone, Debug, Error)]
#[non_exhaustive]
pub enum MessageError {
    /// They do not parse.
    #[error("message: {0}")]
    Malformed(String),
    /// Names, shapes and parameters are longer than they may be.
    #[error("message: more than {MAX_BESIDE_PAYLOAD} bytes beside the tensors' elements and the scan's data")]
    TooMuchBesidePayload,
}

/// Reads a message; fields of bytes share its memory.
pub fn decode<M: Received>(bytes: Bytes) -> Result<M, MessageError> {
    let mut left = MAX_BESIDE_PAYLOAD;
    walk(&bytes, &mut Vec::new(), M::PAYLOAD, &mut left)?;
    M::decode(bytes).map_err(|error| MessageError::Malformed(error.to_string()))
}

/// Walks over a message's fields and takes what is no payload from what is `left`.
fn walk(mut rest: &[u8], way: &mut Vec<u64>, payload: &[&[u64]], left: &mut usize) -> Result<(), MessageError> {
    while !rest.is_empty() {
        let before = rest.len();
        let key = varint(&mut rest)?;
        way.push(key >> 3);
        let length = match key & 7 {
            0 => varint(&mut rest).map(|_| 0)?,
            1 => 8,
            2 => varint(&mut rest)?,
            5 => 4,
            kind => return Err(MessageError::Malformed(format!("field {} is of the unknown kind {kind}", key >> 3))),
        };
        let head = before - rest.len();
        let cut = || MessageError::Malformed(format!("field {} ends beyond the message", key >> 3));
        let (value, after) =
            usize::try_from(length).ok().and_then(|length| rest.split_at_checked(length)).ok_or_else(cut)?;
        let (is_payload, is_on_the_way) = (payload.contains(&&**way), payload.iter().any(|to| to.starts_with(way)));
        let beside = if is_payload || is_on_the_way { head } else { head + value.len() };
        *left = left.checked_sub(beside).ok_or(MessageError::TooMuchBesidePayload)?;
        if is_on_the_way && !is_payload {
            walk(value, way, payload, left)?;
        }
        rest = after;
        way.pop();
    }
    Ok(())
}

fn varint(rest: &mut &[u8]) -> Result<u64, MessageError> {
    let malformed = || MessageError::Malformed("a number has no end".into());
    let end = rest.iter().take(10).position(|byte| byte & 0x80 == 0).ok_or_else(malformed)?;
    let (number, after) = rest.split_at(end + 1);
    *rest = after;
    Ok(number.iter().rev().fold(0, |number, byte| number << 7 | u64::from(byte & 0x7f)))
}

impl Received for inference::ServerLiveRequest {}
impl Received for inference::ServerReadyRequest {}
impl Received for inference::ServerMetadataRequest {}
impl Received for inference::ModelReadyRequest {}
impl Received for inference::ModelMetadataRequest {}

impl Received for inference::ModelInferRequest {
    // `raw_input_contents`; `inputs.contents.fp32_contents`.
    const PAYLOAD: &'static [&'static [u64]] = &[&[7], &[5, 5, 6]];
}

impl Received for scans::ScanRequest {
    // `data`.
    const PAYLOAD: &'static [&'static [u64]] = &[&[2]];
}

#[cfg(test)]
mod tests {
    use prost::Message;

    use super::inference::model_infer_request::InferInputTensor;
    use super::inference::{InferTensorContents, ModelInferRequest};
    use super::scans::ScanRequest;
    use super::*;

    fn problem<M: Received>(bytes: Vec<u8>) -> String {
        decode::<M>(bytes.into()).err().map(|error| error.to_string()).unwrap_or_default()
    }

    #[test]
    fn payload_may_be_long_and_nothing_else() {
        let contents = Some(InferTensorContents { fp32_contents: vec![0.5; 100_000] });
        let typed = InferInputTensor { name: "scan".into(), contents, ..InferInputTensor::default() };
        let request = |inputs| ModelInferRequest {
            inputs,
            raw_input_contents: vec![vec![7; 100_000].into()],
            ..ModelInferRequest::default()
        };
        assert_eq!(problem::<ModelInferRequest>(request(vec![typed]).encode_to_vec()), "");
        let many = request(vec![InferInputTensor::default(); 40_000]);
        assert!(problem::<ModelInferRequest>(many.encode_to_vec()).contains("more than 65536 bytes beside"));
        let scan = ScanRequest { data: vec![7; 100_000].into(), ..ScanRequest::default() };
        assert_eq!(problem::<ScanRequest>(scan.encode_to_vec()), "");
        let counts = ScanRequest { ring_counts: vec![1; 70_000], ..ScanRequest::default() };
        assert!(problem::<ScanRequest>(counts.encode_to_vec()).contains("more than 65536 bytes beside"));
    }

    #[test]
    fn bytes_that_lie_are_refused() {
        assert!(problem::<ScanRequest>(vec![0x12, 0xff, 0x01, 0]).contains("field 2 ends beyond the message"));
        assert!(problem::<ScanRequest>(vec![0xff; 20]).contains("a number has no end"));
        assert!(problem::<ScanRequest>(vec![0x13]).contains("field 2 is of the unknown kind 3"));
        assert!(problem::<ScanRequest>(vec![0x0a, 1, 1]).starts_with("message: "), "a number that is a text");
        let endless = [vec![0x12], vec![0xff; 9], vec![0x01]].concat();
        assert!(problem::<ScanRequest>(endless).contains("field 2 ends beyond the message"));
    }
}
