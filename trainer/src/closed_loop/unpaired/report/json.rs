//! `report.json` of a comparison without twins: the paired loop's keys as far as they apply.

use serde::Serialize;

use super::UnpairedReport;
use crate::closed_loop::outcome::{Interval, Unexplained};
use crate::closed_loop::report::Verdict;
use crate::closed_loop::report::json::{Effect, SCHEMA};
use crate::closed_loop::unpaired::{CANNOT_BE_SEEN, Curve, Noise, Over, Tried, Unseen};

/// The whole document.
#[derive(Serialize)]
pub(super) struct Document<'a> {
    schema: u32,
    mode: &'static str,
    set: &'a str,
    sensor: &'a str,
    model: Digests<'a>,
    scans: Halves,
    scenes: Halves,
    confirm_scenes: Halves,
    seed: u64,
    verdict: Verdict,
    summary: String,
    effects: Vec<Effect<'a>>,
    unexplained: Vec<&'a Unexplained>,
    noise_floor: Noise,
    tried: Vec<Attempt<'a>>,
    cannot_be_seen: &'static [Unseen],
    caveats: &'a [String],
}

#[derive(Serialize)]
struct Digests<'a> {
    before: &'static str,
    after: &'a str,
}

#[derive(Serialize)]
struct Halves {
    simulated: usize,
    measured: usize,
}

#[derive(Serialize)]
struct Attempt<'a> {
    name: &'static str,
    over: Over,
    claimed: bool,
    /// Nats a cell.
    gain: Interval,
    placebo_gain_95: f64,
    p_value: f64,
    q_value: f64,
    size: f64,
    least_size: f64,
    share_of_residual: f64,
    /// Scatter within strata on the confirm scenes, before and after.
    residual: Option<[f64; 2]>,
    curve: &'a Curve,
}

impl<'a> Document<'a> {
    pub(super) fn new(report: &'a UnpairedReport) -> Self {
        let finding = &report.finding;
        let halves = |[simulated, measured]: [usize; 2]| Halves { simulated, measured };
        Self {
            schema: SCHEMA,
            mode: "unpaired",
            set: &report.set,
            sensor: &report.sensor,
            model: Digests { before: "ideal", after: &report.after },
            scans: halves(report.scans),
            scenes: halves(finding.scenes),
            confirm_scenes: halves(finding.confirm),
            seed: report.seed,
            verdict: finding.verdict(),
            summary: report.words(),
            effects: finding.effects().into_iter().map(Effect::new).collect(),
            unexplained: finding.unexplained(),
            noise_floor: finding.noise,
            tried: finding.tried.iter().map(Attempt::new).collect(),
            cannot_be_seen: CANNOT_BE_SEEN,
            caveats: &finding.caveats,
        }
    }
}

impl<'a> Attempt<'a> {
    fn new(tried: &'a Tried) -> Self {
        Self {
            name: tried.over.effect(),
            over: tried.over,
            claimed: tried.found.is_some(),
            gain: tried.gain,
            placebo_gain_95: tried.placebo,
            p_value: tried.p,
            q_value: tried.q,
            size: tried.size[0],
            least_size: tried.size[1],
            share_of_residual: tried.share,
            residual: tried.residual,
            curve: &tried.curve,
        }
    }
}
