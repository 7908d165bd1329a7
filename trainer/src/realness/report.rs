//! Scores for people and for programs.

use std::fmt::Write as _;

use likeness::Score;
use serde::Serialize;

use super::Protocol;

/// Everything that a comparison found, and what it was made with.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// What was judged.
    pub output: String,
    /// What it was judged against.
    pub real: String,
    /// Where the floor is from.
    pub floor: String,
    /// Whose definitions.
    pub protocol: Protocol,
    /// The sensor's name.
    pub sensor: String,
    /// Rings and columns of the images that were compared.
    pub size: [usize; 2],
    /// SHA-256 of the segmentation network's weights.
    pub segmentation_sha256: String,
    /// Draws of the bootstrap.
    pub draws: usize,
    /// Their seed.
    pub seed: u64,
    /// The scores.
    pub scores: Vec<Score>,
}

impl Report {
    /// For a terminal and for the README.
    pub fn to_table(&self) -> String {
        // Writing into a string cannot fail.
        let mut out =
            String::from("| metric | unit | value | 95 % | real against real | scans |\n|---|---|---|---|---|---|\n");
        for s in &self.scores {
            let ci95 = s.ci95.map_or_else(|| "–".into(), |[low, high]| format!("{} to {}", short(low), short(high)));
            let (floor, floor_scans) = s.floor.map_or_else(
                || ("–".into(), String::new()),
                |f| (short(f.value), format!("; {} / {}", f.scans[0], f.scans[1])),
            );
            let Score { metric, value, scans, against, .. } = s;
            let (name, unit, value) = (metric.name, metric.unit, short(*value));
            let _ =
                writeln!(out, "| {name} | {unit} | {value} | {ci95} | {floor} | {scans} / {against}{floor_scans} |");
        }
        let _ = writeln!(
            out,
            "\n{} against {}, at {} × {}; floor: {}.",
            self.output, self.real, self.size[0], self.size[1], self.floor
        );
        for s in &self.scores {
            let _ = writeln!(out, "- {}: {}.", s.metric.name, s.metric.definition);
        }
        out
    }
}

/// Three digits.
pub(crate) fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = (2 - value.abs().log10().floor() as i32).max(0) as usize;
    if digits > 6 { format!("{value:.2e}") } else { format!("{value:.digits$}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits_whatever_their_size() {
        let numbers = [0.0, 1234.5, 12.345, -0.12345, 0.001_234_5, 1.234e-9].map(short);
        assert_eq!(numbers, ["0", "1234", "12.3", "-0.123", "0.00123", "1.23e-9"]);
    }
}
