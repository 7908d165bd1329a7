//! What is thought of a candidate.

use super::candidate::Trial;
use super::outcome::Candidate;

/// A candidate, and whether it may be claimed.
pub struct Judged {
    /// The candidate.
    pub trial: Trial,
    /// Probability of its gain by chance, adjusted for how many were tried.
    pub q_value: f64,
    /// Whether it may be claimed.
    pub passed: bool,
}

impl Judged {
    /// What the report says of it.
    pub fn candidate(&self) -> Candidate {
        Candidate {
            name: self.trial.name().into(),
            gain_nats_per_pixel: self.trial.gain,
            q_value: self.q_value,
            passed: self.passed,
            only_glanced: self.trial.only_glanced,
        }
    }
}

/// Of those that explain the data as well as the best, the simplest; the others that are no more complicated are its ties.
pub fn choose(judged: &[Judged]) -> Option<(&Judged, Vec<String>)> {
    let best = judged.iter().find(|j| j.passed)?;
    let as_good: Vec<&Judged> =
        judged.iter().filter(|j| j.passed && (std::ptr::eq(*j, best) || j.trial.is_as_good_as(&best.trial))).collect();
    let winner = as_good.iter().min_by_key(|j| j.trial.size()).copied()?;
    let ties = as_good
        .iter()
        .filter(|j| !std::ptr::eq(**j, winner) && j.trial.size() <= winner.trial.size())
        .map(|j| j.trial.name().to_owned())
        .collect();
    Some((winner, ties))
}
