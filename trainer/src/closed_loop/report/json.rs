//! `report.json`: what other programs read. Keys stay as they are; new ones may come.

use anyhow::Context;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use super::{Identity, Report, Unseen, Verdict};
use crate::closed_loop::metrics::{EdgeRays, Metric};
use crate::closed_loop::outcome::{Found, Interval, Round, Unexplained};
use crate::closed_loop::screen::{Dependence, EffectCurve};
use crate::effects::Channel;

/// Version of the layout.
pub(in crate::closed_loop) const SCHEMA: u32 = 1;

/// Dependences that are listed of each screening: the strongest.
const LISTED: usize = 40;

/// A document's text.
pub(in crate::closed_loop) fn text(document: &impl Serialize) -> anyhow::Result<String> {
    Ok(serde_json::to_string_pretty(document).context("report.json")? + "\n")
}

/// The whole document.
#[derive(Serialize)]
pub(super) struct Document<'a> {
    schema: u32,
    set: &'a str,
    sensor: &'a str,
    model: Digests<'a>,
    frames: Frames,
    unseen: Unseen,
    seed: u64,
    verdict: Verdict,
    summary: String,
    effects: Vec<Effect<'a>>,
    declared: Vec<Effect<'a>>,
    unexplained: &'a [Unexplained],
    metrics: Metrics<'a>,
    got_worse: &'a [&'static str],
    edge_rays: EdgeRays,
    unexplained_returns_per_scan: f64,
    rounds: &'a [Round],
    curves: &'a [EffectCurve],
    screening: Screenings<'a>,
    caveats: &'a [String],
}

#[derive(Serialize)]
struct Digests<'a> {
    before: &'a str,
    after: &'a str,
}

#[derive(Serialize)]
struct Frames {
    discover: usize,
    tune: usize,
    confirm: usize,
}

#[derive(Serialize)]
pub(in crate::closed_loop) struct Effect<'a> {
    name: &'static str,
    channel: Channel,
    covariates: &'static [&'static str],
    parameters: Parameters<'a>,
    gain_nats_per_pixel: Interval,
    q_value: f64,
    ties: &'a [String],
}

#[derive(Serialize)]
struct Screenings<'a> {
    before: &'a [Dependence],
    after: &'a [Dependence],
}

/// Parameters by name, in the effect's order; one number each, or a list.
struct Parameters<'a>(&'a Found);

/// Metrics by name, in the report's order.
struct Metrics<'a>(&'a [Metric]);

#[derive(Serialize)]
struct Value<T> {
    value: T,
    stderr: T,
}

impl<'a> Document<'a> {
    pub(super) fn new(report: &'a Report) -> Self {
        let Report { identity, outcome, confirmation, .. } = report;
        let Identity { set, sensor, before, after, frames: [discover, tune, confirm], unseen, seed } = identity;
        let strongest = |of: &'a [Dependence]| &of[..of.len().min(LISTED)];
        Self {
            schema: SCHEMA,
            set,
            sensor,
            model: Digests { before, after },
            frames: Frames { discover: *discover, tune: *tune, confirm: *confirm },
            unseen: *unseen,
            seed: *seed,
            verdict: report.verdict(),
            summary: report.words(),
            effects: outcome.effects.iter().map(Effect::new).collect(),
            declared: outcome.declared.iter().map(Effect::new).collect(),
            unexplained: &outcome.unexplained,
            metrics: Metrics(&confirmation.metrics),
            got_worse: &confirmation.got_worse,
            edge_rays: confirmation.edge_rays,
            unexplained_returns_per_scan: confirmation.unexplained_returns_per_scan,
            rounds: &outcome.rounds,
            curves: &report.curves,
            screening: Screenings {
                before: strongest(&outcome.screening_before.dependences),
                after: strongest(&outcome.screening_after.dependences),
            },
            caveats: &outcome.caveats,
        }
    }
}

impl<'a> Effect<'a> {
    pub(in crate::closed_loop) fn new(found: &'a Found) -> Self {
        let about = found.term.effect.about();
        Self {
            name: about.name,
            channel: about.channel,
            covariates: about.covariates,
            parameters: Parameters(found),
            gain_nats_per_pixel: found.gain,
            q_value: found.q_value,
            ties: &found.ties,
        }
    }
}

impl Serialize for Parameters<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let physical = self.0.term.physical();
        let mut map = to.serialize_map(None)?;
        for (parameter, range) in self.0.term.layout() {
            let values = &physical[range.clone()];
            let stderr = self.0.stderr.get(range).unwrap_or_default();
            match values {
                [value] => {
                    let stderr = stderr.first().copied().unwrap_or(f64::NAN);
                    map.serialize_entry(parameter.name, &Value { value: *value, stderr })?;
                }
                _ => map.serialize_entry(parameter.name, &Value { value: values, stderr })?,
            }
        }
        map.end()
    }
}

impl Serialize for Metrics<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Of {
            before: Interval,
            after: Interval,
            ceiling: f64,
            drawn: Option<Interval>,
        }
        to.collect_map(
            self.0
                .iter()
                .map(|m| (m.name, Of { before: m.before, after: m.after, ceiling: m.ceiling, drawn: m.drawn })),
        )
    }
}
