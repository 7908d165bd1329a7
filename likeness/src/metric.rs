//! What is measured, and what came out.

use serde::Serialize;

/// A metric: its name, its unit, and what exactly it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Metric {
    /// Name.
    pub name: &'static str,
    /// Unit; empty for pure numbers.
    pub unit: &'static str,
    /// Definition, with everything that somebody who computes it again has to know.
    pub definition: &'static str,
}

/// A metric's value for a set of scans. All metrics are better when nearer to 0.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Score {
    /// What was measured.
    #[serde(flatten)]
    pub metric: Metric,
    /// What came out.
    pub value: f64,
    /// Of the bootstrap over scans, where it was asked for.
    pub ci95: Option<[f64; 2]>,
    /// Scans that were judged.
    pub scans: usize,
    /// Scans that they were compared with.
    pub against: usize,
    /// What real scans score against real ones.
    pub floor: Option<Floor>,
}

/// A score of real scans against other real scans: what nothing that is judged can be expected to beat.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Floor {
    /// What came out.
    pub value: f64,
    /// Scans on either side.
    pub scans: [usize; 2],
}
