//! How long each stage of a scan's way took.

use std::fmt;
use std::time::{Duration, Instant};

/// A stage of a scan's way through the service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Waiting for a worker.
    Queue,
    /// Bytes into a cloud.
    Decode,
    /// Cloud into a range image.
    Project,
    /// Range image and noise into tensors.
    Tensor,
    /// The model's run.
    Infer,
    /// Checking the model's outputs and deciding which rays are kept.
    Sample,
    /// Range image back into a cloud.
    Reconstruct,
    /// Cloud into bytes.
    Encode,
}

impl Stage {
    /// All stages, in the order of the way.
    pub const ALL: [Self; 8] = [
        Self::Queue,
        Self::Decode,
        Self::Project,
        Self::Tensor,
        Self::Infer,
        Self::Sample,
        Self::Reconstruct,
        Self::Encode,
    ];

    /// The stage's name in the `Server-Timing` header.
    pub fn name(self) -> &'static str {
        match self {
            Self::Queue => "queue",
            Self::Decode => "decode",
            Self::Project => "project",
            Self::Tensor => "tensor",
            Self::Infer => "infer",
            Self::Sample => "sample",
            Self::Reconstruct => "reconstruct",
            Self::Encode => "encode",
        }
    }
}

/// The time that each stage took; shown as a `Server-Timing` header, in milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StageTimes([Duration; Stage::ALL.len()]);

impl StageTimes {
    /// The time of a stage.
    pub fn of(&self, stage: Stage) -> Duration {
        self.0[stage as usize]
    }

    /// Sets the time of a stage.
    pub fn set(&mut self, stage: Stage, time: Duration) {
        self.0[stage as usize] = time;
    }
}

impl fmt::Display for StageTimes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, stage) in Stage::ALL.into_iter().enumerate() {
            let separator = if i == 0 { "" } else { ", " };
            write!(f, "{separator}{};dur={:.3}", stage.name(), self.of(stage).as_secs_f64() * 1e3)?;
        }
        Ok(())
    }
}

/// Splits the time since its start among stages.
#[derive(Debug)]
pub(crate) struct Stopwatch {
    since: Instant,
    times: StageTimes,
}

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self { since: Instant::now(), times: StageTimes::default() }
    }

    /// Books the time since the last call, or the start, on a stage.
    pub(crate) fn lap(&mut self, stage: Stage) {
        let now = Instant::now();
        self.times.set(stage, now - self.since);
        self.since = now;
    }

    pub(crate) fn times(&self) -> StageTimes {
        self.times
    }
}
