//! `realbeam-server`: the service over ONNX Runtime, and batch conversion.

use std::process::ExitCode;

use server::cli::Cli;

fn main() -> ExitCode {
    match Cli::read().and_then(Cli::run) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("realbeam-server: {error:#}");
            ExitCode::FAILURE
        }
    }
}
