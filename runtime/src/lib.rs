//! ONNX Runtime: finding its library, loading it once, saying how to get it where it is missing, and opening a model.
//!
//! The service and the trainer run models through this crate, so that both get the same numbers from the same file.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use ort::environment::Environment;
use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use thiserror::Error;

/// Environment variable that names the library; nothing else is looked at where it is set.
pub const LIBRARY_VARIABLE: &str = "ORT_DYLIB_PATH";

/// The library's file name on this platform.
pub const LIBRARY_NAME: &str = if cfg!(windows) {
    "onnxruntime.dll"
} else if cfg!(target_os = "macos") {
    "libonnxruntime.dylib"
} else {
    "libonnxruntime.so"
};

/// The command that mends a missing library.
const REMEDY: &str = "run `scripts/fetch-onnxruntime.sh` in the Realbeam repository, or set ORT_DYLIB_PATH to the library of ONNX \
                      Runtime 1.24 or newer";

/// Threads that share the work of an operator. A number alone stands for threads that spin for [`SPIN`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Threads {
    /// How many.
    pub number: usize,
    /// How long they spin while they wait for work within a run, before they sleep. Between two runs they sleep.
    pub spin: Duration,
}

/// Long enough for most of the gaps between two operators.
///
/// A thread that was woken from sleep may begin on the core that woke it, and two threads share one core until the system has noticed: the
/// more so the longer the process has slept. Threads that spin longer take the core from others. U-Net at 64 × 2048, two cores, median of
/// a run in ms, by how long after the answer before the next scan comes:
///
/// | spin | 0.1 s | 0.2 s | 0.1 s, another program on one core |
/// |---|---|---|---|
/// | 0 | 28 | 43 | 47 |
/// | 200 µs | 26 | 29 | 53 |
/// | 500 µs | 25 | 25 | 54 |
/// | to the run's end | 23 | 24 | 71 |
pub const SPIN: Duration = Duration::from_micros(200);

impl From<usize> for Threads {
    fn from(number: usize) -> Self {
        Self { number, spin: SPIN }
    }
}

/// ONNX Runtime cannot be used.
#[derive(Debug, Error)]
pub enum RuntimeError {
    /// No library where it is looked for.
    #[error("ONNX Runtime's library is missing: there is no {}; {REMEDY}", list(.looked_at))]
    Missing {
        /// Places looked at, in order.
        looked_at: Vec<PathBuf>,
    },
    /// The file is there, but no usable library.
    #[error("ONNX Runtime's library cannot be loaded: {source}; {REMEDY}")]
    Load {
        /// What the loader says.
        source: ort::LoadDynamicError,
    },
    /// The library does not start.
    #[error("ONNX Runtime does not start: {0}")]
    Start(#[from] ort::Error),
}

/// The process's one environment, loaded on first use.
///
/// The library is the one that `ORT_DYLIB_PATH` names; without it the one beside the executable, or in the directory above (test
/// executables lie one directory below the binaries).
pub fn environment() -> Result<Environment, RuntimeError> {
    // ONNX Runtime allows one environment a process, for as long as the process lives.
    static LOADED: Mutex<Option<Environment>> = Mutex::new(None);
    let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(environment) = &*loaded {
        return Ok(environment.clone());
    }
    let library = find(std::env::var_os(LIBRARY_VARIABLE).map(PathBuf::from), std::env::current_exe().ok().as_deref())?;
    let builder = ort::init_from(&library).map_err(|source| RuntimeError::Load { source })?;
    let environment = builder.with_name("realbeam").with_telemetry(false).build()?;
    Ok(loaded.insert(environment).clone())
}

/// Opens a model, given as the bytes of its file, with `threads` within an operator.
///
/// An older ONNX Runtime that cannot be told for how long its threads should spin has them spin to the end of a run.
pub fn open(environment: &Environment, onnx: &[u8], threads: impl Into<Threads>) -> ort::Result<Session> {
    let Threads { number, spin } = threads.into();
    Session::builder(environment)?
        .with_optimization_level(GraphOptimizationLevel::Level3)?
        .with_intra_threads(number)?
        .with_flush_to_zero()?
        .with_intra_op_spinning(!spin.is_zero())?
        .with_config_entry("session.intra_op.spin_duration_us", spin.as_micros().to_string())?
        .with_config_entry("session.force_spinning_stop", "1")?
        .with_deterministic_compute(true)?
        .commit_from_memory(onnx)
}

/// Where the library lies, given the variable's value and the executable's path.
fn find(variable: Option<PathBuf>, executable: Option<&Path>) -> Result<PathBuf, RuntimeError> {
    let looked_at: Vec<PathBuf> = match variable.filter(|path| !path.as_os_str().is_empty()) {
        // Made absolute against the working directory, as in every other argument; `ort` would try the executable's directory first.
        Some(path) => vec![std::path::absolute(&path).unwrap_or(path)],
        None => {
            executable.into_iter().flat_map(Path::ancestors).skip(1).take(2).map(|d| d.join(LIBRARY_NAME)).collect()
        }
    };
    let found = looked_at.iter().find(|path| path.is_file()).cloned();
    found.ok_or(RuntimeError::Missing { looked_at })
}

fn list(paths: &[PathBuf]) -> String {
    let paths: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
    if paths.is_empty() { "place to look at".into() } else { paths.join(" and no ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_library_is_reported_with_the_command_that_mends_it() {
        let message = |variable: Option<&str>| match find(variable.map(PathBuf::from), Some(Path::new("/no/such/bin")))
        {
            Ok(path) => path.display().to_string(),
            Err(error) => error.to_string(),
        };
        assert_eq!(
            message(None),
            "ONNX Runtime's library is missing: there is no /no/such/libonnxruntime.so and no /no/libonnxruntime.so; run \
             `scripts/fetch-onnxruntime.sh` in the Realbeam repository, or set ORT_DYLIB_PATH to the library of ONNX Runtime 1.24 or \
             newer"
        );
        assert!(message(Some("/elsewhere/lib.so")).contains("there is no /elsewhere/lib.so; run"));
        assert_eq!(message(Some("")), message(None));
    }

    #[test]
    fn the_library_is_found_beside_the_executable_and_one_directory_above() -> Result<(), Box<dyn std::error::Error>> {
        let dir = tempfile::tempdir()?;
        let library = dir.path().join(LIBRARY_NAME);
        std::fs::write(&library, "")?;
        assert_eq!(find(None, Some(&dir.path().join("realbeam-server")))?, library);
        assert_eq!(find(None, Some(&dir.path().join("deps/test")))?, library);
        Ok(())
    }
}
