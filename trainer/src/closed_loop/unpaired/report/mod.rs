//! What a person and other programs read of a comparison without twins.

mod json;
mod page;
mod plot;
mod words;

use super::{Finding, Over};
use crate::closed_loop::report::json::text;

/// Everything that a report shows.
#[derive(Clone, Debug)]
pub struct UnpairedReport {
    /// What was found.
    pub finding: Finding,
    /// Name of the measured scans.
    pub set: String,
    /// Name of their sensor.
    pub sensor: String,
    /// SHA-256 of the model after.
    pub after: String,
    /// Simulated and measured scans.
    pub scans: [usize; 2],
    /// Seed of the run.
    pub seed: u64,
}

impl UnpairedReport {
    /// The answer in sentences, a paragraph a line.
    pub fn words(&self) -> String {
        words::summary(self)
    }

    /// `report.json`.
    pub fn json(&self) -> anyhow::Result<String> {
        text(&json::Document::new(self))
    }

    /// `report.html`: one file that needs no other.
    pub fn html(&self) -> String {
        page::page(self)
    }
}

/// What a covariate is compared in.
fn compared(over: Over) -> &'static str {
    match over {
        Over::Ring => "relative reflectance of the ring",
        Over::Range | Over::Incidence => "relative reflectance",
        Over::Power => "share of returns missing",
    }
}

/// A covariate with its unit.
fn axis(over: Over) -> &'static str {
    match over {
        Over::Ring => "ring (0 = top)",
        Over::Range => "range (m)",
        Over::Incidence => "angle of incidence (°)",
        Over::Power => "ln of the expected power ρ·cos α/r² (1/m²)",
    }
}
