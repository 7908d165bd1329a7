//! The training loop.

use std::io::Write;

use anyhow::{Context, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Map, Value, json};

use super::checkpoint::{self, Progress};
use super::events::Events;
use super::learner::{Learner, Losses};
use super::parts::Parts;
use super::run::Run;

/// How long a run is, and what happens on the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Steps.
    pub steps: usize,
    /// Steps between two checkpoints; each is validated.
    pub checkpoint_every: usize,
    /// Steps between two pictures; 0 = none.
    pub samples_every: usize,
    /// Checkpoints without a better score after which it ends early; 0 = never.
    pub patience: usize,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// All steps are done, or no better score was to be expected.
    Finished,
    /// It was told to stop before, and can be resumed.
    Stopped,
}

/// Teaches a learner; leaves checkpoints, `best.bpk`, `log.jsonl`, an event file for `TensorBoard`, and pictures under `samples/`.
///
/// Losses that are not finite are an error; the batch that gave them is kept, and the last checkpoint stands.
pub fn teach(learner: &mut dyn Learner, plan: &Plan, run: &Run, newest: Option<&std::path::Path>) -> Result<Ending> {
    let mut progress = Progress { step: 0, best: None };
    if let Some(newest) = newest {
        let parts;
        (parts, progress) = checkpoint::load(newest)?;
        learner.load(&parts).with_context(|| format!("checkpoint {}", newest.display()))?;
        tracing::info!(step = progress.step, "resumed");
    }
    let mut desk = Desk { log: run.log(progress.step)?, events: Events::create(&run.out, progress.step)? };
    let bar = progress_bar(plan.steps, progress.step);
    let last = run.stop_after.map_or(plan.steps, |stop| stop.min(plan.steps));
    while progress.step < last && !plan.is_hopeless(progress) {
        let losses = learner.learn(progress.step);
        if losses.iter().any(|(_, loss)| !loss.is_finite()) {
            let kept = run.keep_batch(progress.step, &learner.batch(progress.step))?;
            bail!(
                "step {}: a loss is not finite ({}); its batch is in {}, the last checkpoint stands",
                progress.step,
                words(&losses),
                kept.display()
            );
        }
        progress.step += 1;
        bar.set_position(progress.step as u64);
        bar.set_message(words(&losses));
        desk.losses(progress.step, &losses)?;
        if plan.samples_every > 0 && progress.step.is_multiple_of(plan.samples_every) {
            let samples = run.out.join("samples");
            std::fs::create_dir_all(&samples)?;
            let picture = learner.picture()?;
            lidar::formats::write_atomically(&samples.join(format!("{:07}.png", progress.step)), &picture)?;
        }
        if progress.step.is_multiple_of(plan.checkpoint_every) || progress.step == last {
            validate(learner, &mut progress, run, &mut desk)?;
            let mut parts = Parts::default();
            learner.save(&mut parts)?;
            checkpoint::save(&run.out, &parts, progress)?;
        }
    }
    bar.finish();
    if plan.is_hopeless(progress) {
        tracing::info!(step = progress.step, best = ?progress.best, "no better for so long that training ends here");
        return Ok(Ending::Finished);
    }
    Ok(if progress.step < plan.steps { Ending::Stopped } else { Ending::Finished })
}

impl Plan {
    /// Whether a run has gone so long without a better score that it ends.
    fn is_hopeless(&self, progress: Progress) -> bool {
        let wait = self.patience * self.checkpoint_every;
        wait > 0 && progress.best.is_some_and(|(_, best)| progress.step >= best + wait)
    }
}

/// Where figures are noted.
struct Desk {
    log: std::fs::File,
    events: Events,
}

impl Desk {
    fn losses(&mut self, step: usize, losses: &Losses) -> Result<()> {
        let mut entry: Map<String, Value> = losses.iter().map(|(name, loss)| ((*name).into(), json!(loss))).collect();
        entry.insert("step".into(), json!(step));
        writeln!(self.log, "{}", Value::Object(entry))?;
        let curves = losses.iter().map(|(name, loss)| (format!("loss/{name}"), f64::from(*loss)));
        self.events.scalars(step, curves)
    }
}

/// Scores the network and keeps it if it is the best so far.
fn validate(learner: &dyn Learner, progress: &mut Progress, run: &Run, desk: &mut Desk) -> Result<()> {
    let validation = learner.validate()?;
    let entry = json!({"step": progress.step, "validation": validation.scores, "total": validation.total});
    writeln!(desk.log, "{entry}")?;
    let curves = validation.curves.iter().map(|(name, score)| (format!("validation/{name}"), *score));
    desk.events.scalars(progress.step, curves.chain([("validation/total".into(), validation.total)]))?;
    tracing::info!(step = progress.step, total = validation.total, scores = ?validation.curves, "validation");
    if progress.best.is_none_or(|(best, _)| validation.total < best) {
        progress.best = Some((validation.total, progress.step));
        lidar::formats::write_atomically(&run.best(), &learner.weights()?)?;
    }
    Ok(())
}

fn words(losses: &Losses) -> String {
    losses.iter().map(|(name, loss)| format!("{name} {loss:.4}")).collect::<Vec<_>>().join(" ")
}

fn progress_bar(steps: usize, done: usize) -> ProgressBar {
    let bar = ProgressBar::new(steps as u64).with_position(done as u64);
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} {elapsed}<{eta} {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, Tensor};

    use super::super::learner::Validation;
    use super::*;

    /// Learns without fault up to its third step.
    struct Faulty;

    impl Learner for Faulty {
        fn learn(&mut self, step: usize) -> Losses {
            vec![("game", if step < 2 { 0.5 } else { f32::NAN })]
        }

        fn save(&self, parts: &mut Parts) -> Result<()> {
            parts.put("network", vec![1]);
            Ok(())
        }

        fn load(&mut self, _: &Parts) -> Result<()> {
            Ok(())
        }

        fn validate(&self) -> Result<Validation> {
            Ok(Validation { total: 1.0, scores: json!({}), curves: vec![] })
        }

        fn weights(&self) -> Result<Vec<u8>> {
            Ok(vec![1])
        }

        fn picture(&self) -> Result<Vec<u8>> {
            Ok(vec![])
        }

        fn batch(&self, step: usize) -> Vec<(&'static str, Tensor<4>)> {
            vec![("simulated", Tensor::full([1, 3, 2, 4], step as f32, &Device::flex()))]
        }
    }

    #[test]
    fn a_loss_that_is_no_number_ends_the_run_with_its_batch_kept_and_the_last_checkpoint() -> Result<()> {
        let root = tempfile::tempdir()?;
        let out = root.path().to_path_buf();
        let run = Run { out: out.clone(), data: out.clone(), resume: false, stop_after: None };
        let plan = Plan { steps: 9, checkpoint_every: 1, samples_every: 0, patience: 0 };
        let error = teach(&mut Faulty, &plan, &run, None).map_or_else(|e| e.to_string(), |_| String::new());
        assert!(error.contains("step 2") && error.contains("batch-0000002.npz"), "{error}");
        let (_, progress) = checkpoint::load(&checkpoint::newest(&out)?.context("no checkpoint")?)?;
        assert_eq!(progress.step, 2);
        let mut kept = npyz::npz::NpzArchive::open(out.join("batch-0000002.npz"))?;
        let array = kept.by_name("simulated")?.context("no array")?;
        assert_eq!(array.shape(), [1, 3, 2, 4]);
        assert_eq!(array.into_vec::<f32>()?, [2.0; 24]);
        Ok(())
    }

    #[test]
    fn a_run_ends_once_it_has_not_got_better_for_as_long_as_it_may() {
        let plan = Plan { steps: 1000, checkpoint_every: 10, samples_every: 0, patience: 3 };
        let at = |step| Progress { step, best: Some((1.0, 100)) };
        assert!(!plan.is_hopeless(at(129)) && plan.is_hopeless(at(130)));
        assert!(!Plan { patience: 0, ..plan }.is_hopeless(at(900)));
        assert!(!plan.is_hopeless(Progress { step: 900, best: None }));
    }
}
