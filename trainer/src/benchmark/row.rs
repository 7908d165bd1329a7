//! A line of the benchmark's file: what was hidden in one set, and what the loop said.

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

use anyhow::{Context, Result, bail};
use hidden::{Defect, Noise};
use serde::{Deserialize, Serialize};

use super::case::Case;
use crate::closed_loop::outcome::{Found, Outcome};
use crate::effects::Channel;

/// One set: truth and answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What was asked.
    #[serde(flatten)]
    pub case: Case,
    /// Of streets, poses, sensor and noise.
    pub seed: u64,
    /// Name of the sensor, with rings and columns.
    pub sensor: String,
    /// What the sensor does besides.
    pub noise: Noise,
    /// What was hidden.
    pub truth: Vec<Defect>,
    /// What the loop said.
    pub reply: Reply,
    /// How long it took, without making the set.
    pub seconds: f64,
}

/// What the loop said, if it did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reply {
    /// It ended.
    Answer(Answer),
    /// It refused the set, or panicked: why.
    Failed(String),
}

/// What the loop said.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// In a word.
    pub verdict: Verdict,
    /// The effects that it added, in their order.
    pub effects: Vec<Named>,
    /// What it has no name for, in the order of the report.
    pub unexplained: Vec<Dependence>,
    /// What it decided, round by round.
    pub rounds: Vec<Step>,
    /// Share of the reducible error that is gone on the confirm scenes, in the channels that the defect acts on; none where nothing is
    /// reducible.
    pub removed: Option<f64>,
}

/// The answer in a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Neither an effect nor a dependence without a name.
    NothingMissing,
    /// At least one effect.
    EffectsAdded,
    /// No effect, but a dependence without a name.
    UnexplainedOnly,
}

/// An effect that was added.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// Effects that explain the data as well.
    pub ties: Vec<String>,
    /// Held-out gain when it was added, in nats a ray.
    pub gain_nats_per_pixel: f64,
    /// Its parameters.
    pub parameters: Vec<Numbers>,
}

/// A parameter: one number, or several.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Numbers {
    /// Name with unit.
    pub name: String,
    /// The numbers.
    pub values: Vec<f64>,
    /// Their standard errors.
    pub stderr: Vec<f64>,
}

/// A dependence without a name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dependence {
    /// Its channel.
    pub channel: Channel,
    /// What it depends on.
    pub covariates: Vec<String>,
}

/// One round of the loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// What was done.
    pub decision: String,
    /// The best candidates: name, held-out gain in nats a ray, and whether it passed.
    pub best: Vec<(String, f64, bool)>,
}

/// Candidates of a round that a row keeps.
const BEST: usize = 5;

impl Answer {
    /// The part of a loop's outcome that is judged.
    pub fn new(outcome: &Outcome, removed: Option<f64>) -> Self {
        let effects: Vec<Named> = outcome.effects.iter().map(Named::new).collect();
        let unexplained = outcome.unexplained.iter();
        let unexplained: Vec<Dependence> =
            unexplained.map(|u| Dependence { channel: u.channel, covariates: u.covariates.clone() }).collect();
        let verdict = match (effects.is_empty(), unexplained.is_empty()) {
            (false, _) => Verdict::EffectsAdded,
            (true, false) => Verdict::UnexplainedOnly,
            (true, true) => Verdict::NothingMissing,
        };
        let rounds = outcome.rounds.iter().map(|round| Step {
            decision: round.decision.clone(),
            best: (round.candidates.iter().take(BEST))
                .map(|c| (c.name.clone(), c.gain_nats_per_pixel.value, c.passed))
                .collect(),
        });
        Self { verdict, effects, unexplained, rounds: rounds.collect(), removed }
    }
}

impl Named {
    fn new(found: &Found) -> Self {
        let values = found.term.physical();
        let numbers = found.term.layout().into_iter().map(|(parameter, range)| Numbers {
            name: parameter.name.into(),
            values: values[range.clone()].to_vec(),
            stderr: found.stderr.get(range).map(<[f64]>::to_vec).unwrap_or_default(),
        });
        Self {
            name: found.term.name().into(),
            ties: found.ties.clone(),
            gain_nats_per_pixel: found.gain.value,
            parameters: numbers.collect(),
        }
    }
}

/// Adds a row to a file, whole and at once.
pub fn append(file: &mut File, row: &Row) -> Result<()> {
    let mut line = serde_json::to_vec(row)?;
    line.push(b'\n');
    file.write_all(&line)?;
    Ok(file.flush()?)
}

/// Opens a file for rows, with those that a run before left there. A last line that was not finished is cut off.
pub fn resume(path: &Path) -> Result<(File, Vec<Row>)> {
    let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
    let mut text = String::new();
    file.read_to_string(&mut text).with_context(|| format!("{}", path.display()))?;
    let whole = text.rfind('\n').map_or(0, |end| end + 1);
    let mut rows = Vec::new();
    for (n, line) in text[..whole].lines().enumerate() {
        match serde_json::from_str(line) {
            Ok(row) => rows.push(row),
            Err(error) => bail!("{}, line {}: no row of this benchmark: {error}", path.display(), n + 1),
        }
    }
    file.set_len(whole as u64)?;
    file.seek(SeekFrom::End(0))?;
    Ok((file, rows))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::benchmark::{Extent, Suite};

    /// A row of a case, with an answer.
    pub(in crate::benchmark) fn row(suite: Suite, names: &[&str], answer: Answer) -> Row {
        let names = names.iter().map(|name| (*name).to_owned()).collect();
        let case = Case { suite, names, size: 1.0, number: 0 };
        let recipe = case.recipe(Extent::Small);
        Row {
            case,
            seed: recipe.seed,
            sensor: recipe.sensor.name.clone(),
            noise: recipe.noise,
            truth: recipe.hidden,
            reply: Reply::Answer(answer),
            seconds: 2.0,
        }
    }

    /// An answer of effects with their ties.
    pub(in crate::benchmark) fn answer(effects: &[(&str, &[&str])], unexplained: Vec<Dependence>) -> Answer {
        let effects = effects.iter().map(|(name, ties)| Named {
            name: (*name).into(),
            ties: ties.iter().map(|tie| (*tie).into()).collect(),
            gain_nats_per_pixel: 0.1,
            parameters: vec![],
        });
        Answer {
            verdict: Verdict::EffectsAdded,
            effects: effects.collect(),
            unexplained,
            rounds: vec![],
            removed: None,
        }
    }

    #[test]
    fn a_run_that_was_killed_goes_on_after_its_last_whole_row() -> Result<()> {
        let dir = tempfile::tempdir()?;
        let path = dir.path().join("rows.jsonl");
        let first = row(Suite::Single, &["range_walk"], answer(&[("range_walk", &[])], vec![]));
        append(&mut resume(&path)?.0, &first)?;
        let half = serde_json::to_string(&first)?;
        OpenOptions::new().append(true).open(&path)?.write_all(&half.as_bytes()[..40])?;

        let (mut file, rows) = resume(&path)?;
        assert_eq!(rows, std::slice::from_ref(&first));
        append(&mut file, &first)?;
        assert_eq!(resume(&path)?.1.len(), 2);
        Ok(())
    }

    #[test]
    fn a_file_of_something_else_is_refused_by_its_line() -> Result<()> {
        let dir = tempfile::tempdir()?;
        let path = dir.path().join("rows.jsonl");
        std::fs::write(&path, "{\"suite\": \"single\"}\n")?;
        let error = resume(&path).err().context("refused")?.to_string();
        assert!(error.contains("rows.jsonl, line 1"), "{error}");
        Ok(())
    }
}
