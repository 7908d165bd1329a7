//! What Burn computes and what ONNX Runtime computes from the exported file are the same numbers.
//!
//! Every file that these tests export also passes Python's `onnx.checker`, where Python has it.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod checker;
mod comparison;
mod composing;
mod dynamic;
mod elementwise;
mod file;
mod layers;
mod norms;
mod refusals;
mod resizing;
mod runtime;
mod sample;
mod shapes;
