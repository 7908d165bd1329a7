//! The service over ONNX Runtime, and batch conversion.
//!
//! A scan's way is written once, in [`pipeline`]. [`serve`](serve()) runs it behind HTTP on worker threads that own their session,
//! [`convert`](convert()) runs it on files; both read models from a [`repository`], where one model is one ONNX file that carries its
//! own card. Finding ONNX Runtime itself is the matter of the crate [`runtime`].

pub mod address;
mod batch;
mod budget;
pub mod canary;
pub mod catalogue;
pub mod check;
pub mod cli;
pub mod config;
pub mod convert;
pub mod coverage;
mod generator;
mod http;
pub mod inspect;
mod listen;
mod loader;
mod metrics;
pub mod model;
pub mod onnx_file;
pub mod pipeline;
pub mod repository;
mod sampled;
pub mod serve;
mod source;
pub mod statistics;
pub mod stopwatch;
mod streams;
mod tensors;
pub mod tls;
pub mod token;
mod traces;
pub mod trial;
mod view;
pub mod worker;

pub use address::Address;
pub use canary::Canary;
pub use catalogue::WorkerOptions;
pub use check::CheckOptions;
pub use config::{AdminOptions, Config, ConnectionLimits, RequestLimits, StopOptions};
pub use convert::{Conversion, convert};
pub use generator::{Chance, Noise};
pub use model::{MAX_MODEL_BYTES, Model};
pub use pipeline::{Pipeline, ScanAnswer, ScanJob};
pub use repository::Repository;
pub use runtime::Threads;
pub use serve::{Server, serve};
pub use tls::TlsFiles;
pub use token::Token;
pub use traces::TracesError;
pub use worker::Caller;
