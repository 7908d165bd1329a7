//! The answer in plain words.

use super::numbers::{digits, length, percent};
use super::sentence::filled;
use super::{Report, Unseen};
use crate::closed_loop::outcome::{Found, Unexplained};
use crate::effects::Channel;

/// The whole answer, a paragraph a line.
pub(super) fn summary(report: &Report) -> String {
    let mut lines: Vec<String> = report.outcome.effects.iter().map(found).collect();
    lines.extend(report.outcome.declared.iter().map(declared));
    lines.extend(report.outcome.unexplained.iter().map(unexplained));
    lines.extend(improvement(report));
    lines.push(rest(report));
    let worse = &report.confirmation.got_worse;
    if !worse.is_empty() {
        let named: Vec<&str> = worse.iter().map(|name| metric_name(name)).collect();
        lines.push(format!("Worse than before: {}.", named.join(", ")));
    }
    lines.extend(report.outcome.caveats.iter().map(|caveat| format!("Note: {caveat}.")));
    lines.join("\n")
}

/// What the sensor does, as a sentence.
pub(in crate::closed_loop) fn found(found: &Found) -> String {
    let does = filled(found.term.effect.about().does, &found.term, &found.stderr);
    let ties = match found.ties.as_slice() {
        [] => String::new(),
        ties => format!(" These data cannot tell this from {}.", ties.join(" or ").replace('_', " ")),
    };
    format!("The sensor {does}.{ties}")
}

fn declared(known: &Found) -> String {
    let does = filled(known.term.effect.about().does, &known.term, &known.stderr);
    format!("As the model already knew, the sensor {does}.")
}

/// A dependence without a name, as a sentence.
pub(super) fn unexplained(what: &Unexplained) -> String {
    let table = if what.added_as_table { "; a smooth table over it has been added" } else { "" };
    format!(
        "Something is missing that the library has no name for: {} depending on {} ({} of the residual{table}).",
        depends(what.channel),
        what.covariates.join(" and ").replace('_', " "),
        percent(what.share_of_residual)
    )
}

/// What adding it all was worth, in the metrics that the additions are about.
fn improvement(report: &Report) -> Option<String> {
    let outcome = &report.outcome;
    let channels: Vec<Channel> = outcome
        .effects
        .iter()
        .map(|f| f.term.effect.about().channel)
        .chain(outcome.unexplained.iter().filter(|u| u.added_as_table).map(|u| u.channel))
        .collect();
    let mut names: Vec<&str> = channels.iter().filter_map(|c| metric_of(*c)).collect();
    let mut seen = std::collections::BTreeSet::new();
    names.retain(|name| seen.insert(*name));
    let added = outcome.effects.len() + outcome.unexplained.iter().filter(|u| u.added_as_table).count();
    let it = if added == 1 { "it" } else { "them" };
    let on = match report.identity.unseen {
        Unseen::Scenes => "scenes never seen before",
        Unseen::Frames => "frames never seen before",
        Unseen::Nothing => "the frames that were fitted",
    };
    let part = |(i, name): (usize, &&str)| {
        let metric = report.confirmation.of(name)?;
        let show = |x: f64| value(name, x);
        let on = if i == 0 { format!(" on {on}") } else { String::new() };
        Some(format!(
            "the {}{on} from {} to {} (ceiling {})",
            metric_name(name),
            show(metric.before.value),
            show(metric.after.value),
            show(metric.ceiling)
        ))
    };
    let parts: Vec<String> = names.iter().enumerate().filter_map(part).collect();
    let (last, others) = parts.split_last()?;
    let others = if others.is_empty() { String::new() } else { format!("{} and ", others.join(", ")) };
    Some(format!("Adding {it} takes {others}{last}."))
}

/// What is left.
fn rest(report: &Report) -> String {
    let outcome = &report.outcome;
    if outcome.unexplained.iter().any(|u| !u.added_as_table) {
        return "This is not all: no effect or table that was tried passes for what is left.".into();
    }
    if !outcome.unexplained.is_empty() {
        return "Nothing beyond that was found.".into();
    }
    if !outcome.effects.is_empty() {
        return "Nothing else is missing.".into();
    }
    let range = report.confirmation.of("range_mae_m").map_or(String::new(), |m| {
        format!(
            " The range error is {}, of which {} is the sensor's own noise.",
            length(m.after.value),
            length(m.ceiling)
        )
    });
    format!("Nothing is missing: the sensor does what the model says.{range}")
}

/// The metric that tells most of a channel; noise has none, for an error is no smaller when its size is known.
fn metric_of(channel: Channel) -> Option<&'static str> {
    match channel {
        Channel::Range | Channel::Geometry => Some("range_mae_m"),
        Channel::RangeVariance => None,
        Channel::Reflectance => Some("reflectance_mae"),
        Channel::Missing => Some("keep_log_loss"),
        Channel::Extra => Some("extra_returns_per_scan"),
    }
}

/// A metric in words.
pub(super) fn metric_name(name: &str) -> &'static str {
    match name {
        "range_mae_m" => "range error",
        "range_rmse_m" => "root mean square range error",
        "range_bias_m" => "mean range deviation",
        "keep_log_loss" => "logarithmic loss of return or no return",
        "keep_brier" => "Brier score of return or no return",
        "reflectance_mae" => "reflectance error",
        "extra_returns_per_scan" => "number of unpredicted extra returns a scan",
        "chamfer_m" => "distance between the clouds",
        _ => "unnamed metric",
    }
}

/// A metric's value with its unit.
pub(super) fn value(name: &str, x: f64) -> String {
    match name {
        _ if name.ends_with("_m") => length(x),
        "keep_log_loss" => format!("{} nats", digits(x, 3)),
        _ => digits(x, 3),
    }
}

/// A channel's name.
pub(super) fn channel_name(channel: Channel) -> &'static str {
    match channel {
        Channel::Range => "range",
        Channel::RangeVariance => "spread of the range",
        Channel::Geometry => "geometry",
        Channel::Reflectance => "reflectance",
        Channel::Missing => "missing returns",
        Channel::Extra => "extra returns",
    }
}

fn depends(channel: Channel) -> &'static str {
    match channel {
        Channel::Range => "ranges are off",
        Channel::RangeVariance => "the noise of the range varies",
        Channel::Geometry => "rays are bent",
        Channel::Reflectance => "reflectance is off",
        Channel::Missing => "returns are lost",
        Channel::Extra => "returns come out of nowhere",
    }
}
