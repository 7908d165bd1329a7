//! The service as its users meet it: over HTTP and gRPC, on files, from the command line. Needs ONNX Runtime (scripts/fetch-onnxruntime.sh).

mod added;
mod answers;
mod command_line;
mod conversion;
mod docs;
mod errors;
mod formats;
mod grpc;
mod hostile;
mod load;
mod metrics;
mod models;
mod open_inference;
mod page;
mod plugins;
mod ring_counts;
mod support;
mod swap;
mod tls;
mod token;
mod traces;
mod unix_socket;
mod vanish;
mod views;
