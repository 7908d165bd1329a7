//! Checkpoints: all that a run needs to go on, in one folder that is there whole or not at all.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::store::ModuleRecord;
use burn::tensor::Bytes;
use serde::{Deserialize, Serialize};

/// Where a run stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Steps done.
    pub step: usize,
    /// Validation score of the best network so far (lower is better), and its step.
    pub best: Option<(f64, usize)>,
}

/// Writes `run/checkpoint-<step>`, then removes older ones.
pub fn save<M: Module>(run: &Path, network: &M, optimizer: &ModuleOptimizer, progress: Progress) -> Result<()> {
    let building = tempfile::Builder::new().prefix(".checkpoint-").tempdir_in(run)?;
    let write = |name: &str, bytes: &[u8]| -> Result<()> {
        let path = building.path().join(name);
        std::fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
        std::fs::File::open(&path)?.sync_all()?;
        Ok(())
    };
    write("network.bpk", &network_bytes(network)?)?;
    write("optimizer.bpk", &optimizer.into_bytes()?)?;
    write("progress.json", &serde_json::to_vec_pretty(&progress)?)?;
    let place = run.join(format!("checkpoint-{:07}", progress.step));
    if place.exists() {
        std::fs::remove_dir_all(&place)?;
    }
    std::fs::rename(building.keep(), &place).with_context(|| format!("cannot publish {}", place.display()))?;
    for old in list(run)? {
        if old != place {
            std::fs::remove_dir_all(old)?;
        }
    }
    Ok(())
}

/// The newest checkpoint of a run, if it has one.
pub fn newest(run: &Path) -> Result<Option<PathBuf>> {
    Ok(list(run)?.pop())
}

/// Reads a checkpoint into a network and an optimiser of the same shape.
pub fn load<M: Module>(
    checkpoint: &Path,
    network: M,
    optimizer: ModuleOptimizer,
) -> Result<(M, ModuleOptimizer, Progress)> {
    let read = |name: &str| {
        let path = checkpoint.join(name);
        std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))
    };
    let progress = serde_json::from_slice(&read("progress.json")?).context("progress.json")?;
    let network = load_network(&checkpoint.join("network.bpk"), network)?;
    let optimizer = optimizer.from_bytes(Bytes::from_bytes_vec(read("optimizer.bpk")?)).context("optimizer.bpk")?;
    Ok((network, optimizer, progress))
}

/// Writes a network's weights, whole or not at all.
pub fn save_network<M: Module>(path: &Path, network: &M) -> Result<()> {
    lidar::formats::write_atomically(path, &network_bytes(network)?)
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Reads weights into a network of the same shape; what is missing or of another shape is an error.
pub fn load_network<M: Module>(path: &Path, network: M) -> Result<M> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    ensure!(!bytes.is_empty(), "{} is empty", path.display());
    let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(bytes))
        .with_context(|| format!("{} holds no weights", path.display()))?;
    network
        .try_load_record(record)
        .with_context(|| format!("{} holds other weights than this network's", path.display()))
}

fn network_bytes<M: Module>(network: &M) -> Result<Bytes> {
    Ok(network.clone().into_record().into_bytes()?)
}

fn list(run: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(run).with_context(|| format!("cannot read {}", run.display()))? {
        let path = entry?.path();
        if path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.starts_with("checkpoint-")) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}
