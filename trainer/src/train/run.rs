//! A run's folder: config, log, checkpoints, pictures, the best network.

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use burn::tensor::Tensor;
use npyz::WriterBuilder;
use npyz::npz::NpzWriter;
use npyz::zip::write::FileOptions;

use super::checkpoint;

/// What a run is told beside its config.
#[derive(Clone, Debug)]
pub struct Run {
    /// Where checkpoints, the log, the config and the best network go.
    pub out: PathBuf,
    /// Folder that the config's data paths are relative to.
    pub data: PathBuf,
    /// Go on from the newest checkpoint in `out`.
    pub resume: bool,
    /// Stop (with a checkpoint) after this step, as if interrupted there.
    pub stop_after: Option<usize>,
}

impl Run {
    /// Makes the folder, or finds it as a run of the same config left it; returns the checkpoint to go on from.
    ///
    /// A folder that holds a run is not written to unless the run is to be resumed, and not resumed with another config.
    pub fn open(&self, config: &str) -> Result<Option<PathBuf>> {
        let out = &self.out;
        std::fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
        let newest = checkpoint::newest(out)?;
        ensure!(
            self.resume || newest.is_none(),
            "{} holds a run already: go on with --resume, or choose another --out",
            out.display()
        );
        if self.resume {
            let before = std::fs::read_to_string(out.join("config.toml")).context("nothing to resume here")?;
            ensure!(before == config, "the config differs from that of the run in {}", out.display());
        }
        lidar::formats::write_atomically(&out.join("config.toml"), config.as_bytes())?;
        Ok(newest)
    }

    /// Where the best network's weights go.
    pub fn best(&self) -> PathBuf {
        best_of(&self.out)
    }

    /// The log, one JSON document a line, without what a run that was killed wrote after its last checkpoint.
    pub(super) fn log(&self, step: usize) -> Result<File> {
        let path = self.out.join("log.jsonl");
        let before = if path.exists() { std::fs::read_to_string(&path)? } else { String::new() };
        let written = |line: &&str| {
            let line: Option<serde_json::Value> = serde_json::from_str(line).ok();
            line.and_then(|line| line["step"].as_u64()).is_some_and(|at| at <= step as u64)
        };
        let kept: String = before.lines().filter(written).flat_map(|line| [line, "\n"]).collect();
        lidar::formats::write_atomically(&path, kept.as_bytes())?;
        Ok(OpenOptions::new().append(true).open(&path)?)
    }

    /// Keeps what a step was shown: one array a name in `batch-<step>.npz`.
    pub(super) fn keep_batch(&self, step: usize, batch: &[(&'static str, Tensor<4>)]) -> Result<PathBuf> {
        let path = self.out.join(format!("batch-{step:07}.npz"));
        let mut file = NpzWriter::create(&path).with_context(|| format!("cannot write {}", path.display()))?;
        for (name, tensor) in batch {
            let shape = tensor.dims().map(|n| n as u64);
            let mut array =
                file.array::<f32>(name, FileOptions::default())?.default_dtype().shape(&shape).begin_nd()?;
            array.extend(tensor.to_data().iter::<f32>())?;
            array.finish()?;
        }
        Ok(path)
    }
}

/// Where the weights of the best network of a run's folder are.
pub fn best_of(run: &Path) -> PathBuf {
    run.join("best.bpk")
}
