//! Requests and answers of the Open Inference Protocol's `infer`, with its binary tensor extension, for float32 tensors.
//!
//! Protocol: <https://github.com/kserve/open-inference-protocol>, `specification/protocol/inference_rest.md`; extension:
//! <https://github.com/triton-inference-server/server>, `docs/protocol/extension_binary_data.md`.

mod answer;
mod few;
mod flat;
mod messages;
mod request;

pub use answer::Answer;
pub use messages::InferHead;
pub use request::{InferRequest, RequestError};

/// Header with the bytes of JSON at the beginning of a body; what follows are tensors, little-endian. 0: the body is one tensor and
/// nothing else.
pub const HEADER_LENGTH: &str = "inference-header-content-length";

/// The only type of elements that Realbeam's tensors have.
pub const DATATYPE: &str = "FP32";

/// A named float32 tensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Its name.
    pub name: String,
    /// Lengths of its axes; their product is the number of elements.
    pub shape: Vec<usize>,
    /// Its elements, the last axis running fastest.
    pub values: Vec<f32>,
}
