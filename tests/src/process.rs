//! The built binaries as child processes.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result, bail};

use crate::client::Client;

/// A `realbeam-server serve` at a free port of its own. Dropping it ends it.
#[derive(Debug)]
pub struct RunningServer {
    process: Child,
    address: String,
}

impl RunningServer {
    /// Starts the server on a folder of models and waits until it takes scans.
    pub fn start(models: &Path, arguments: &[&str]) -> Result<Self> {
        let mut process = Command::new(binary("realbeam-server")?)
            .args(["serve", "--addr", "127.0.0.1:0", "--models"])
            .arg(models)
            .args(arguments)
            .env("RUST_LOG", "info")
            .stderr(Stdio::piped())
            .spawn()
            .context("cannot start realbeam-server")?;
        let log = process.stderr.take().context("the server's log")?;
        let mut lines = BufReader::new(log).lines();
        let mut said = String::new();
        for line in lines.by_ref() {
            let line = line?;
            if let Some((_, address)) = line.split_once("listening at ") {
                let address = address.trim().to_owned();
                // The log must go on being read, or the server would wait for room in the pipe.
                std::thread::spawn(move || lines.for_each(drop));
                return Ok(Self { process, address });
            }
            said += &line;
            said.push('\n');
        }
        bail!("realbeam-server did not start; it said:\n{said}")
    }

    /// A client of this server.
    pub fn client(&self) -> Client {
        Client::new(&self.address)
    }

    /// Where it listens, such as `http://127.0.0.1:40321`.
    pub fn address(&self) -> &str {
        &self.address
    }
}

impl Drop for RunningServer {
    fn drop(&mut self) {
        // It may have ended by itself; there is nothing to do about either.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Path of one of the workspace's binaries, built beside this one.
pub fn binary(name: &str) -> Result<PathBuf> {
    let this = std::env::current_exe()?;
    for folder in this.ancestors().skip(1).take(2) {
        let path = folder.join(name).with_extension(std::env::consts::EXE_EXTENSION);
        if path.is_file() {
            return Ok(path);
        }
    }
    bail!("{name} is not built; run `make build`")
}

/// The models that ship with the repository.
pub fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../models")
}
