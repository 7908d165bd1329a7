//! End to end: the built binaries, started as a user starts them, and a client that speaks to them over HTTP.

pub mod client;
pub mod process;

pub use client::{Answer, Client};
pub use process::{RunningServer, binary, models};
