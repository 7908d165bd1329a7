//! Checkpoints: all that a run needs to go on, in one folder that is there whole or not at all.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use burn::module::Module;
use burn::store::ModuleRecord;
use burn::tensor::Bytes;
use serde::{Deserialize, Serialize};

use super::parts::Parts;

/// How the names of checkpoints begin, and of those that are being written.
const PREFIX: &str = "checkpoint-";
const BUILDING: &str = ".checkpoint-";

/// How the names of parts end.
const EXTENSION: &str = "bpk";

/// Where a run stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Steps done.
    pub step: usize,
    /// Validation score of the best network so far (lower is better), and its step.
    pub best: Option<(f64, usize)>,
}

/// Writes `run/checkpoint-<step>`, then removes older ones, and what a run that was killed left half-written.
pub fn save(run: &Path, parts: &Parts, progress: Progress) -> Result<()> {
    let building = tempfile::Builder::new().prefix(BUILDING).tempdir_in(run)?;
    let write = |name: &str, bytes: &[u8]| -> Result<()> {
        let path = building.path().join(name);
        std::fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
        std::fs::File::open(&path)?.sync_all()?;
        Ok(())
    };
    for (name, bytes) in parts.iter() {
        write(&format!("{name}.{EXTENSION}"), bytes)?;
    }
    write("progress.json", &serde_json::to_vec_pretty(&progress)?)?;
    let place = run.join(format!("{PREFIX}{:07}", progress.step));
    if place.exists() {
        std::fs::remove_dir_all(&place)?;
    }
    std::fs::rename(building.keep(), &place).with_context(|| format!("cannot publish {}", place.display()))?;
    std::fs::File::open(run)?.sync_all()?;
    for old in folders(run, PREFIX)?.into_iter().chain(folders(run, BUILDING)?) {
        if old != place {
            std::fs::remove_dir_all(old)?;
        }
    }
    Ok(())
}

/// The newest checkpoint of a run, if it has one.
pub fn newest(run: &Path) -> Result<Option<PathBuf>> {
    Ok(folders(run, PREFIX)?.pop())
}

/// Reads a checkpoint.
pub fn load(checkpoint: &Path) -> Result<(Parts, Progress)> {
    let mut parts = Parts::default();
    let read = |path: &Path| std::fs::read(path).with_context(|| format!("cannot read {}", path.display()));
    for entry in std::fs::read_dir(checkpoint).with_context(|| format!("cannot read {}", checkpoint.display()))? {
        let path = entry?.path();
        if let (Some(extension), Some(name)) = (path.extension(), path.file_stem().and_then(|name| name.to_str()))
            && extension == EXTENSION
        {
            parts.put(name, read(&path)?);
        }
    }
    let progress = serde_json::from_slice(&read(&checkpoint.join("progress.json"))?).context("progress.json")?;
    Ok((parts, progress))
}

/// Writes a network's weights, whole or not at all.
pub fn save_network<M: Module>(path: &Path, network: &M) -> Result<()> {
    lidar::formats::write_atomically(path, &network_bytes(network)?)
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Reads weights into a network of the same shape; what is missing or of another shape is an error.
pub fn load_network<M: Module>(path: &Path, network: M) -> Result<M> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    network_from(&bytes, network).with_context(|| format!("weights {}", path.display()))
}

/// A network's weights.
pub fn network_bytes<M: Module>(network: &M) -> Result<Vec<u8>> {
    Ok(network.clone().into_record().into_bytes()?.to_vec())
}

/// A network with weights from [`network_bytes`] of one of the same shape.
pub fn network_from<M: Module>(bytes: &[u8], network: M) -> Result<M> {
    ensure!(!bytes.is_empty(), "no bytes");
    let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(bytes.to_vec())).context("no weights")?;
    network.try_load_record(record).context("weights of another network")
}

fn folders(run: &Path, prefix: &str) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(run).with_context(|| format!("cannot read {}", run.display()))? {
        let path = entry?.path();
        if path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.starts_with(prefix)) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}
