//! Sets made, given to the loop and written down, several at a time.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Instant;

use anyhow::{Context, Result};
use hidden::{HiddenFrame, Recipe, frames};

use super::case::{Case, Extent};
use super::removed::removed;
use super::row::{Answer, Reply, Row};
use crate::closed_loop::calibrate::{calibrate, pairs};
use crate::closed_loop::metrics::confirm;
use crate::closed_loop::model::SensorModel;
use crate::sets::{Frame, PairedSet};

/// How to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// How large the sets are.
    pub extent: Extent,
    /// Sets at a time; each has its share of the processor's threads.
    pub jobs: usize,
}

/// Runs the loop on every case and gives each row away as soon as it is there, in whatever order. Ends at the first error of `take`, once the
/// sets in work are done.
pub fn run(cases: &[Case], run: Run, mut take: impl FnMut(Row) -> Result<()>) -> Result<()> {
    let jobs = run.jobs.clamp(1, cases.len().max(1));
    let threads = std::thread::available_parallelism().map_or(1, usize::from).div_ceil(jobs);
    let next = AtomicUsize::new(0);
    let (sender, rows) = mpsc::channel();
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().context("threads of a job")?;
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if sender.send(pool.install(|| row(case, run.extent))).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        for row in rows {
            if let Err(error) = take(row) {
                next.store(cases.len(), Ordering::Relaxed);
                return Err(error);
            }
        }
        Ok(())
    })
}

fn row(case: &Case, extent: Extent) -> Row {
    let recipe = case.recipe(extent);
    let made = frames(&recipe);
    let begun = Instant::now();
    // A set that breaks the loop is a result: the others go on.
    let answered = catch_unwind(AssertUnwindSafe(|| answer(&recipe, &made)));
    let reply = match answered {
        Ok(Ok(answer)) => Reply::Answer(answer),
        Ok(Err(error)) => Reply::Failed(format!("{error:#}")),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref().copied());
            Reply::Failed(format!("panicked: {}", text.unwrap_or("without a word")))
        }
    };
    Row {
        case: case.clone(),
        seed: recipe.seed,
        sensor: recipe.sensor.name.clone(),
        noise: recipe.noise,
        truth: recipe.hidden.clone(),
        reply,
        seconds: begun.elapsed().as_secs_f64(),
    }
}

fn answer(recipe: &Recipe, made: &[HiddenFrame]) -> Result<Answer> {
    let scenes = (0..recipe.scenes).map(|scene| format!("street-{scene:02}")).collect();
    let frame = |(number, frame): (usize, &HiddenFrame)| Frame {
        name: format!("{number:06}"),
        scene: frame.scene,
        simulated: frame.simulated.clone(),
        measured: frame.measured.clone(),
        measured_extra: 0,
    };
    let frames = made.iter().enumerate().map(frame).collect();
    let set = PairedSet::from_frames("hidden", recipe.sensor.clone(), scenes, frames)?;
    let before = SensorModel::ideal(set.sensor.rings().len());
    let calibration = calibrate(&set, &pairs(&set), &before, recipe.seed, &|_| ());
    let outcome = &calibration.outcome;
    let batches: Vec<_> = calibration.confirm.iter().collect();
    let confirmation = confirm(&outcome.before, &outcome.after, &batches, recipe.seed);
    Ok(Answer::new(outcome, removed(&confirmation, recipe)))
}
