//! What of an answer is right.

use hidden::Defect;

use super::quantity::{Quantity, quantities};
use super::row::{Answer, Dependence, Named, Reply, Row, Verdict};
use super::suite::Suite;
use crate::effects::Channel;

/// An answer, judged by the rules of [the benchmark](super).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Judgement {
    /// Whether the suite's question is answered: see the rules.
    pub right: bool,
    /// Whether it is, or the truth is among the ties of the first effect.
    pub right_or_tied: bool,
    /// Added effects that are no defect of the set.
    pub false_names: Vec<String>,
    /// The first effect or, if there is none, dependence that was reported; `nothing` else.
    pub said: String,
    /// The numbers of the defects that were named, each with the defect's name.
    pub quantities: Vec<(&'static str, Quantity)>,
    /// Share of the reducible error that is gone.
    pub removed: Option<f64>,
}

impl Judgement {
    /// Judges a row.
    pub fn of(row: &Row) -> Self {
        match &row.reply {
            Reply::Failed(_) => Self { said: "failed".into(), ..Self::default() },
            Reply::Answer(answer) => Self::of_answer(row, answer),
        }
    }

    fn of_answer(row: &Row, answer: &Answer) -> Self {
        let names: Vec<&'static str> = row.truth.iter().filter_map(Defect::name).collect();
        let first = answer.effects.first();
        let is_first = |name: &str| first.is_some_and(|effect| effect.name == name);
        let ties_first = |name: &str| first.is_some_and(|effect| effect.ties.iter().any(|tie| tie == name));
        let claimed = |name: &str| {
            answer.effects.iter().any(|effect| effect.name == name || effect.ties.iter().any(|tie| tie == name))
        };
        let (right, right_or_tied) = match row.case.suite {
            Suite::Single | Suite::Size => {
                let right = names.iter().all(|name| is_first(name));
                (right, right || names.iter().all(|name| ties_first(name)))
            }
            Suite::Pairs => {
                let named = |name: &&str| answer.effects.iter().any(|effect| effect.name == *name);
                (names.iter().all(named), names.iter().all(|name| claimed(name)))
            }
            Suite::Unknown => {
                let right =
                    answer.unexplained.first().is_some_and(|found| row.truth.iter().all(|t| explains(found, t)));
                (right, right)
            }
            Suite::Nothing => {
                let right = answer.verdict == Verdict::NothingMissing;
                (right, right)
            }
        };
        let is_false = |effect: &&Named| {
            !names.iter().any(|name| effect.name == *name || effect.ties.iter().any(|tie| tie == name))
        };
        let others: Vec<&str> = answer.effects.iter().map(|effect| effect.name.as_str()).collect();
        let numbers = |defect: &Defect| {
            let name = defect.title();
            let named = answer.effects.iter().find(|effect| effect.name == name);
            let found = named.map(|named| quantities(defect, &row.noise, named, &others)).unwrap_or_default();
            found.into_iter().map(move |quantity| (name, quantity))
        };
        Self {
            right,
            right_or_tied,
            false_names: answer.effects.iter().filter(is_false).map(|effect| effect.name.clone()).collect(),
            said: said(answer),
            quantities: row.truth.iter().flat_map(numbers).collect(),
            removed: answer.removed,
        }
    }
}

fn said(answer: &Answer) -> String {
    let first = answer.effects.first().map(|effect| effect.name.clone());
    let unexplained = || {
        answer.unexplained.first().map(|found| {
            let channel = format!("{:?}", found.channel).to_lowercase();
            format!("{channel} by {}", found.covariates.join(", "))
        })
    };
    first.or_else(unexplained).unwrap_or_else(|| "nothing".into())
}

/// Whether a dependence is of the defect's channel and has exactly its covariates, by any of their names.
fn explains(found: &Dependence, defect: &Defect) -> bool {
    let Defect::Unknown(unknown) = defect else { return false };
    let channel = match unknown.channel() {
        hidden::Channel::Geometry => Channel::Geometry,
        hidden::Channel::Range => Channel::Range,
        hidden::Channel::Reflectance => Channel::Reflectance,
        hidden::Channel::Missing => Channel::Missing,
        hidden::Channel::Extra => Channel::Extra,
    };
    let covariates = unknown.covariates();
    let is_there = |names: &&[&str]| found.covariates.iter().any(|covariate| names.contains(&covariate.as_str()));
    found.channel == channel && found.covariates.len() == covariates.len() && covariates.iter().all(is_there)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::benchmark::row::tests::{answer, row};

    #[test]
    fn the_right_name_has_to_be_first_and_exact() {
        let judged = |effects: &[(&str, &[&str])]| {
            Judgement::of(&row(Suite::Single, &["elevation_offset"], answer(effects, vec![])))
        };
        assert!(judged(&[("elevation_offset", &[])]).right);
        assert!(!judged(&[("elevation_offset_per_ring", &[])]).right);
        let second = judged(&[("mount_pitch", &[]), ("elevation_offset", &[])]);
        assert!(!second.right && !second.right_or_tied);
        assert_eq!(second.false_names, ["mount_pitch"]);
        let tied = judged(&[("mount_pitch", &["elevation_offset"])]);
        assert!(!tied.right && tied.right_or_tied && tied.false_names.is_empty());
        assert!(!judged(&[]).right_or_tied);
    }

    #[test]
    fn a_pair_needs_both_in_whatever_order() {
        let judged = |effects: &[(&str, &[&str])]| {
            Judgement::of(&row(Suite::Pairs, &["range_offset", "range_scale"], answer(effects, vec![])))
        };
        assert!(judged(&[("range_scale", &[]), ("range_offset", &[])]).right);
        let tied = judged(&[("range_scale", &["range_offset"])]);
        assert!(!tied.right && tied.right_or_tied);
        assert!(!judged(&[("range_scale", &[])]).right_or_tied);
    }

    #[test]
    fn what_has_no_name_is_told_by_channel_and_covariates_and_no_more() {
        let judged = |channel, covariates: &[&str]| {
            let covariates = covariates.iter().map(|c| (*c).to_owned()).collect();
            let found = vec![Dependence { channel, covariates }];
            Judgement::of(&row(Suite::Unknown, &["range_by_ring_and_range"], answer(&[], found))).right
        };
        assert!(judged(Channel::Range, &["range", "ring"]));
        assert!(!judged(Channel::Reflectance, &["range", "ring"]));
        assert!(!judged(Channel::Range, &["ring"]));
        assert!(!judged(Channel::Range, &["ring", "range", "class"]));
        assert!(!judged(Channel::Range, &["ring", "ring"]));
    }

    #[test]
    fn a_set_without_an_answer_is_not_right_even_where_nothing_is_missing() {
        let mut failed = row(Suite::Nothing, &[], answer(&[], vec![]));
        failed.reply = Reply::Failed("no overlap".into());
        assert!(!Judgement::of(&failed).right);
    }
}
