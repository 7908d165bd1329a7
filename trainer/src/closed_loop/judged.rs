//! What is thought of a candidate.

use super::candidate::Trial;
use super::outcome::{Candidate, Interval};

/// A candidate, and whether it may be claimed.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The candidate.
    pub trial: Trial,
    /// Probability of its gain by chance, adjusted for how many were tried.
    pub q_value: f64,
    /// Whether it may be claimed.
    pub passed: bool,
    /// What it gains where what it depends on was drawn by lot, if that was tried.
    pub placebo: Option<Interval>,
}

impl Judged {
    /// A candidate whose placebo has not been tried.
    pub fn new(passed: bool, trial: Trial, q_value: f64) -> Self {
        Self { trial, q_value, passed, placebo: None }
    }

    /// Its name.
    pub fn name(&self) -> &'static str {
        self.trial.name()
    }

    /// What the report says of it.
    pub fn candidate(&self) -> Candidate {
        Candidate {
            name: self.trial.name().into(),
            gain_nats_per_pixel: self.trial.gain,
            q_value: self.q_value,
            passed: self.passed,
            placebo_gain: self.placebo,
            only_glanced: self.trial.only_glanced,
        }
    }
}

/// Of those `among` the passed that explain the data as well as the best, the simplest, by its place; the others that are no more
/// complicated are its ties.
pub fn choose(judged: &[Judged], among: impl Fn(&Judged) -> bool) -> Option<(usize, Vec<String>)> {
    let best = judged.iter().position(|j| j.passed && among(j))?;
    let is_as_good = |i: &usize| {
        judged[*i].passed && among(&judged[*i]) && (*i == best || judged[*i].trial.is_as_good_as(&judged[best].trial))
    };
    let as_good: Vec<usize> = (0..judged.len()).filter(is_as_good).collect();
    let size = |i: usize| judged[i].trial.size();
    let winner = as_good.iter().copied().min_by_key(|i| size(*i))?;
    let ties = as_good.into_iter().filter(|i| *i != winner && size(*i) <= size(winner));
    Some((winner, ties.map(|i| judged[i].trial.name().to_owned()).collect()))
}
