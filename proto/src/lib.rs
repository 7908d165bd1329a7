//! The contracts between the rooms and with the world: the model card inside an ONNX file, media types, the error body.

pub mod card;

pub use card::Card;
