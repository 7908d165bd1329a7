//! The contracts between the rooms and with the world: the model card inside an ONNX file, media types, the error body,
//! tensors on the wire.

pub mod card;
pub mod error;
pub mod grpc;
pub mod media;
pub mod open_inference;

pub use card::Card;
pub use error::{ErrorBody, ErrorCode};
pub use media::{AnswerType, Form, Frame, MediaType};
