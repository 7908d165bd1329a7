//! A model's check in a process of its own, with limits on memory and time: a hostile graph can crash ONNX Runtime, and nothing but
//! another process survives that.

use std::io::{self, Read, Write};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use thiserror::Error;
use tokio_util::sync::CancellationToken;

use crate::model::Model;
use crate::trial::try_out;

/// Hidden subcommand of `realbeam-server` that is the child: model on stdin, on stdout what is wrong with it.
pub(crate) const SUBCOMMAND: &str = "check-model";

/// Longest reason that is taken from the child, in bytes.
const MAX_REASON: u64 = 4096;

/// How often the child is looked at.
const GLANCE: Duration = Duration::from_millis(5);

/// How models are checked before they are served.
#[derive(Clone, Debug)]
pub struct CheckOptions {
    /// The `realbeam-server` to start for it. Without one, as in a program that has none beside it, a model's file is only read:
    /// models must then be trusted.
    pub program: Option<PathBuf>,
    /// Bytes of address space that the process may have.
    pub memory_bytes: u64,
    /// Time that it may take.
    pub time: Duration,
}

/// A model that did not pass.
#[derive(Debug, Error)]
pub enum CheckError {
    /// The process does not start.
    #[error("its check does not start: {0}")]
    Start(#[source] io::Error),
    /// It found something wrong.
    #[error("refused by its check: {0}")]
    Refused(String),
    /// It ended without a word.
    #[error("crashed its check ({0}), which had {1} bytes of memory")]
    Crashed(String, u64),
    /// It was not done in time.
    #[error("its check was not done within {} s", .0.as_secs_f64())]
    TooSlow(Duration),
    /// The service ends.
    #[error("its check was given up, for the service is stopping")]
    Stopped,
}

impl CheckOptions {
    /// Checks the bytes of a model's file; blocks until the child is done, too slow, or no longer wanted.
    pub(crate) fn check(&self, bytes: &[u8], stop: &CancellationToken) -> Result<(), CheckError> {
        let Some(program) = &self.program else { return Ok(()) };
        let mut command = Command::new(program);
        // CPU time is limited too, in case that the service is killed and nobody is left to watch the clock.
        let time_s = self.time.as_secs() + 1;
        command.arg(SUBCOMMAND).arg(format!("--memory-bytes={}", self.memory_bytes)).arg(format!("--time-s={time_s}"));
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.env_remove(crate::config::TOKEN_VARIABLE).spawn().map_err(CheckError::Start)?;
        let (stdin, stdout) = (child.stdin.take(), child.stdout.take());
        let status = thread::scope(|scope| {
            // A child that dies early does not listen to the end.
            scope.spawn(move || stdin.map(|mut stdin| stdin.write_all(bytes)));
            let ended = self.watch(&mut child, stop);
            // Whatever happened, there is no child after this, and nothing holds up the thread that writes to it.
            let _ = child.kill();
            let _ = child.wait();
            ended
        })?;
        let mut reason = Vec::new();
        stdout.map(|stdout| stdout.take(MAX_REASON).read_to_end(&mut reason)).transpose().map_err(CheckError::Start)?;
        match status.code() {
            Some(0) => Ok(()),
            Some(_) if !reason.is_empty() => Err(CheckError::Refused(String::from_utf8_lossy(&reason).trim().into())),
            _ => Err(CheckError::Crashed(status.to_string(), self.memory_bytes)),
        }
    }

    fn watch(&self, child: &mut Child, stop: &CancellationToken) -> Result<std::process::ExitStatus, CheckError> {
        let started = Instant::now();
        loop {
            if let Some(status) = child.try_wait().map_err(CheckError::Start)? {
                return Ok(status);
            }
            if stop.is_cancelled() {
                return Err(CheckError::Stopped);
            }
            if started.elapsed() > self.time {
                return Err(CheckError::TooSlow(self.time));
            }
            thread::sleep(GLANCE);
        }
    }
}

/// The child's side: holds itself to its limits, then reads a model from stdin and tries it out. An error has been printed to stdout
/// already.
pub(crate) fn check_stdin(memory_bytes: u64, time_s: u64) -> anyhow::Result<()> {
    let checked = (|| -> anyhow::Result<()> {
        confine(memory_bytes, time_s)?;
        let mut bytes = Vec::new();
        io::stdin().read_to_end(&mut bytes)?;
        Ok(try_out(&Model::from_bytes(bytes)?)?)
    })();
    if let Err(error) = &checked {
        print!("{error}");
    }
    checked
}

/// Limits this process's memory and time, and leaves no core file of either's size.
#[cfg(unix)]
fn confine(memory_bytes: u64, time_s: u64) -> io::Result<()> {
    use rlimit::Resource;
    [(Resource::AS, memory_bytes), (Resource::CPU, time_s), (Resource::CORE, 0)]
        .into_iter()
        .try_for_each(|(resource, limit)| resource.set(limit, limit))
}

/// Elsewhere only the clock limits a child.
#[cfg(not(unix))]
#[allow(clippy::unnecessary_wraps)]
fn confine(_: u64, _: u64) -> io::Result<()> {
    Ok(())
}

impl Default for CheckOptions {
    fn default() -> Self {
        Self { program: None, memory_bytes: 4 << 30, time: Duration::from_mins(1) }
    }
}
