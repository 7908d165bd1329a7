//! Sums over everything that a model was asked.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crate::stopwatch::{Stage, StageTimes};

/// The running sums of one model.
#[derive(Debug, Default)]
pub struct Statistics(Mutex<Totals>);

/// A number of times and how long they took together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sum {
    /// How often.
    pub count: u64,
    /// How long.
    pub time: Duration,
}

/// The sums.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Totals {
    /// Milliseconds since 1970 at the last success; 0 before the first.
    pub last_ms: u64,
    /// Work that succeeded, waiting included.
    pub success: Sum,
    /// Work that failed.
    pub fail: Sum,
    /// Waiting for a worker.
    pub queue: Sum,
    /// The stages before the model's run.
    pub before: Sum,
    /// The model's run.
    pub infer: Sum,
    /// The stages after it.
    pub after: Sum,
}

impl Statistics {
    /// Counts work that succeeded.
    pub fn succeeded(&self, times: &StageTimes) {
        let of = |stages: &[Stage]| stages.iter().map(|stage| times.of(*stage)).sum::<Duration>();
        self.edit(|totals| {
            totals.last_ms = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_millis() as u64;
            totals.success.add(of(&Stage::ALL));
            totals.queue.add(of(&[Stage::Queue]));
            totals.before.add(of(&[Stage::Decode, Stage::Project, Stage::Tensor]));
            totals.infer.add(of(&[Stage::Infer]));
            totals.after.add(of(&[Stage::Sample, Stage::Reconstruct, Stage::Encode]));
        });
    }

    /// Counts work that failed after so long.
    pub fn failed(&self, time: Duration) {
        self.edit(|totals| totals.fail.add(time));
    }

    /// The sums up to now.
    pub fn totals(&self) -> Totals {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn edit(&self, edit: impl FnOnce(&mut Totals)) {
        edit(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

impl Sum {
    fn add(&mut self, time: Duration) {
        self.count += 1;
        self.time += time;
    }
}
