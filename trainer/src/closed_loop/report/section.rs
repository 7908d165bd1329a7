//! The sections of the page.

use std::fmt::Write as _;

use super::html::escaped;
use super::numbers::{chance, digits, gain as nats, interval, percent, with_error};
use super::picture::{DIVERGING, ranges, residuals};
use super::words::{channel_name, found, metric_name, unexplained as without_a_name, value};
use super::{Report, plot};
use crate::closed_loop::metrics::Metric;
use crate::closed_loop::outcome::{Found, Round};
use crate::closed_loop::screen::{Dependence, Map, Screening, unit};
use crate::effects::{Channel, Covariate};

/// Dependences in the table.
const DEPENDENCES: usize = 12;

/// Candidates of a round in the table.
const CANDIDATES: usize = 8;

/// Rings of which a parameter's numbers are written out.
const WRITTEN_OUT: usize = 8;

/// Errors before and after.
pub(super) fn metrics(report: &Report) -> String {
    let worse = &report.confirmation.got_worse;
    let mut rows = String::new();
    for metric in &report.confirmation.metrics {
        let cell = |of: &crate::closed_loop::outcome::Interval| {
            let (shown, ends) = interval(of, |x| value(metric.name, x));
            format!("<td><b>{shown}</b><small>{ends}</small></td>")
        };
        let drawn = metric.drawn.as_ref().map_or_else(|| "<td>–</td>".into(), cell);
        let class = if worse.contains(&metric.name) { r#" class="worse""# } else { "" };
        let _ = writeln!(
            rows,
            "<tr{class}><th>{}<small>{}</small></th>{}{}<td>{}</td><td>{}</td>{drawn}</tr>",
            metric_name(metric.name),
            metric.name,
            cell(&metric.before),
            cell(&metric.after),
            value(metric.name, metric.ceiling),
            removed(metric),
        );
    }
    let edges = &report.confirmation.edge_rays;
    let near_edges = if edges.share > 0.0 {
        format!(
            "{} of the rays pass so near an edge that an image cannot know which side they hit (mean distance {} before, {} after), and ",
            percent(edges.share),
            value("range_mae_m", edges.before_mae_m),
            value("range_mae_m", edges.after_mae_m),
        )
    } else {
        String::new()
    };
    format!(
        r#"<section>
<h2>Errors on the confirm frames</h2>
<p>Frames that were opened once, at the end. In small print the 95 % interval, from a bootstrap over scenes. The ceiling is what no model
could predict: the fitted noise of the model after. “Removed” is (before − after) / (before − ceiling). The last column is one scan drawn
with noise and lost rays, as conversion writes it: its own noise comes on top.</p>
<table class="numbers">
<thead><tr><th></th><th>before</th><th>after</th><th>ceiling</th><th>removed</th><th>one drawn scan</th></tr></thead>
<tbody>
{rows}</tbody>
</table>
<p class="fine">Counted apart: {near_edges}{stray} returns a scan that neither model explains by a surface.</p>
</section>
"#,
        stray = digits(report.confirmation.unexplained_returns_per_scan, 3),
    )
}

/// Share of the reducible error that is gone, where there was any to speak of.
fn removed(metric: &Metric) -> String {
    let (before, after) = (metric.before.value.abs(), metric.after.value.abs());
    let reducible = before - metric.ceiling;
    if reducible > 0.02 * metric.ceiling.max(1e-12) && reducible > 1e-9 {
        percent((before - after) / reducible)
    } else {
        "–".into()
    }
}

/// Each effect with its numbers and its curve.
pub(super) fn effects(report: &Report) -> String {
    let outcome = &report.outcome;
    if outcome.effects.is_empty() && outcome.declared.is_empty() {
        return String::new();
    }
    let mut out = String::from("<section>\n<h2>Effects</h2>\n");
    for effect in &outcome.effects {
        let about = effect.term.effect.about();
        let (gain, ends) = interval(&effect.gain, nats);
        let _ = write!(
            out,
            "<article>\n<h3>{} <code>{}</code></h3>\n<p>{}</p>\n{}<p class=\"fine\">Gain on scenes held out: {gain} nats per thousand rays ({ends}), q {}. \
             Formula: {}. Source: {}.</p>\n",
            sentence_case(about.name),
            about.name,
            escaped(found(effect)),
            parameters(effect),
            chance(effect.q_value),
            escaped(about.formula),
            escaped(about.source),
        );
        if let Some(curve) = report.curves.iter().find(|c| c.effect == about.name) {
            let _ = write!(
                out,
                "<figure>\n{}\n<figcaption><span class=\"key without\">residual without it</span> <span class=\"key effect\">the fitted effect</span> \
                 <span class=\"key with\">residual with it</span> on the confirm frames; bars are 95 % intervals over scenes{}</figcaption>\n</figure>\n",
                plot::curve(curve),
                if about.channel == Channel::Geometry { ". Moved rays show in the range" } else { "" },
            );
        }
        out.push_str("</article>\n");
    }
    for effect in &outcome.declared {
        let about = effect.term.effect.about();
        let _ = write!(
            out,
            "<article>\n<h3>{} <code>{}</code> <small>declared, refitted</small></h3>\n<p>{}</p>\n{}</article>\n",
            sentence_case(about.name),
            about.name,
            escaped(found(effect)),
            parameters(effect),
        );
    }
    out + "</section>\n"
}

fn parameters(of: &Found) -> String {
    let physical = of.term.physical();
    let mut rows = String::new();
    for (parameter, range) in of.term.layout() {
        let error = |i: usize| of.stderr.get(i).copied().unwrap_or(f64::NAN);
        let shown = if range.len() <= WRITTEN_OUT {
            range.map(|i| with_error(physical[i], error(i), "")).collect::<Vec<_>>().join(", ")
        } else {
            let each = range.clone().map(|i| digits(physical[i], 3)).collect::<Vec<_>>().join(", ");
            let mean = range.clone().map(error).sum::<f64>() / range.len() as f64;
            format!("{each} <small>(each ± {})</small>", digits(1.96 * mean, 1))
        };
        let _ = write!(rows, "<tr><th><code>{}</code></th><td>{shown}</td></tr>", parameter.name);
    }
    format!("<table class=\"parameters\"><tbody>{rows}</tbody></table>\n")
}

/// Residual maps before and after.
pub(super) fn maps(report: &Report) -> anyhow::Result<String> {
    let outcome = &report.outcome;
    let (before, after) = (&outcome.screening_before.maps, &outcome.screening_after.maps);
    let concerned: Vec<Channel> = outcome
        .effects
        .iter()
        .map(|f| f.term.effect.about().channel)
        .chain(outcome.unexplained.iter().map(|u| u.channel))
        .collect();
    let shown = |map: &&Map| {
        matches!(map.channel, Channel::Range | Channel::Reflectance | Channel::Missing)
            || concerned.contains(&map.channel)
    };
    let mut out = String::new();
    for map in before.iter().filter(shown) {
        let Some(then) = after.iter().find(|m| m.channel == map.channel) else { continue };
        let scale = scale(&map.mean);
        let picture = |caption: &str, map: &Map| -> anyhow::Result<String> {
            let address = residuals(&map.mean, map.columns, scale)?;
            Ok(format!(
                "<figure><img class=\"map\" src=\"{address}\" alt=\"\"><figcaption>{caption}</figcaption></figure>"
            ))
        };
        let _ = write!(
            out,
            "<h3>{}</h3>\n<div class=\"pair\">{}{}</div>\n{}",
            sentence_case(channel_name(map.channel)),
            picture("before", map)?,
            picture("after", then)?,
            legend(scale, map.channel)
        );
    }
    if out.is_empty() {
        return Ok(out);
    }
    Ok(format!(
        "<section>\n<h2>Residual maps</h2>\n<p>Measured minus predicted, averaged over the frames that the loop worked on: one pixel a ray, rings from top to \
         bottom, the whole turn from left to right with straight ahead in the middle. Grey: nothing measured.</p>\n{out}</section>\n"
    ))
}

/// What all but a fiftieth of the map stays within, rounded up.
fn scale(mean: &[f32]) -> f64 {
    let mut sizes: Vec<f32> = mean.iter().filter(|v| v.is_finite()).map(|v| v.abs()).collect();
    sizes.sort_by(f32::total_cmp);
    let at = sizes.get(sizes.len() * 49 / 50).or(sizes.last()).copied().map_or(1.0, f64::from).max(1e-6);
    let power = 10f64.powf(at.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= at).unwrap_or(at)
}

fn legend(scale: f64, channel: Channel) -> String {
    let colours: Vec<String> = DIVERGING.iter().map(|[r, g, b]| format!("rgb({r},{g},{b})")).collect();
    let end = digits(scale, 1);
    format!(
        "<p class=\"legend\"><span>−{end}</span><i style=\"background:linear-gradient(90deg,{})\"></i><span>+{end}</span> {}</p>\n",
        colours.join(","),
        unit(channel)
    )
}

/// A confirm frame as the simulation, the sensor and the model have it.
pub(super) fn view(report: &Report) -> anyhow::Result<String> {
    let Some(view) = &report.view else { return Ok(String::new()) };
    let mut out = format!(
        "<section>\n<h2>Frame {} of the confirm frames</h2>\n<p>Range from 2 m (red) to 100 m (blue) by its logarithm; black: no return.</p>\n",
        view.frame
    );
    for (caption, scan) in [
        ("simulated", &view.simulated),
        ("measured", &view.measured),
        ("predicted by the model after: medians, without its random noise and losses", &view.predicted),
    ] {
        let _ = writeln!(
            out,
            "<figure><img class=\"scan\" src=\"{}\" alt=\"\"><figcaption>{caption}</figcaption></figure>",
            ranges(scan)?
        );
    }
    Ok(out + "</section>\n")
}

/// What has no name.
pub(super) fn unexplained(report: &Report) -> String {
    if report.outcome.unexplained.is_empty() {
        return String::new();
    }
    let mut items = String::new();
    for what in &report.outcome.unexplained {
        let _ = writeln!(items, "<li>{} q {}.</li>", escaped(without_a_name(what)), chance(what.q_value));
    }
    format!(
        "<section>\n<h2>Unexplained</h2>\n<p>A residual that depends on something, as no effect of the library does. What a table removes is \
         counted in the errors above, but it is a description, not an explanation.</p>\n<ul>\n{items}</ul>\n</section>\n"
    )
}

/// The screening, before and after.
pub(super) fn screening(report: &Report) -> String {
    let (before, after) = (&report.outcome.screening_before, &report.outcome.screening_after);
    let shown: Vec<&Dependence> =
        before.dependences.iter().filter(|d| d.q_value < 0.05 && d.share > 0.0).take(DEPENDENCES).collect();
    if before.dependences.is_empty() {
        return String::new();
    }
    let mut rows = String::new();
    for d in &shown {
        let then = find(after, d);
        let share = then.map_or("–".into(), |t| percent(t.share));
        let bar = |share: f64| format!("<i style=\"width:{:.1}%\"></i>", (share * 100.0).clamp(0.0, 100.0));
        let _ = writeln!(
            rows,
            "<tr><th>{}</th><th>{}</th><td class=\"bar\">{}<b>{}</b><small>{} to {}</small></td><td>{}</td><td class=\"bar after\">{}<b>{share}</b></td></tr>",
            channel_name(d.channel),
            names(&d.covariates),
            bar(d.share),
            percent(d.share),
            percent(d.ci95[0]),
            percent(d.ci95[1]),
            chance(d.q_value),
            bar(then.map_or(0.0, |t| t.share)),
        );
    }
    let left = after.dependences.iter().filter(|d| d.q_value < 0.05 && d.share > 0.005).count();
    let table = if rows.is_empty() {
        "<p>Nothing depends on anything, beyond chance.</p>".into()
    } else {
        format!(
            "<table class=\"numbers\"><thead><tr><th>channel</th><th>depends on</th><th>share before</th><th>q</th><th>share after</th></tr></thead>\n\
             <tbody>\n{rows}</tbody></table>"
        )
    };
    format!(
        "<section>\n<h2>Screening</h2>\n<p>How much of each channel's residual depends on what, fitted on half of the scenes and measured on the other; a \
         pair counts what it adds to its singles. {} dependences were looked at, q is adjusted for all of them. Afterwards {left} of more than 0.5 % \
         remain.</p>\n{table}\n<p class=\"fine\">Azimuth and sweep phase are functions of one another on a sensor that turns steadily: phase is named \
         only where the residual jumps at the seam.</p>\n</section>\n",
        before.dependences.len()
    )
}

fn find<'a>(screening: &'a Screening, like: &Dependence) -> Option<&'a Dependence> {
    // After the loop the residual may no longer jump at the seam.
    let same = |a: &Covariate, b: &Covariate| {
        let turns = |c: &Covariate| matches!(c, Covariate::Azimuth | Covariate::SweepPhase);
        a == b || turns(a) && turns(b)
    };
    let alike = |d: &&Dependence| {
        d.channel == like.channel
            && d.covariates.len() == like.covariates.len()
            && d.covariates.iter().zip(&like.covariates).all(|(a, b)| same(a, b))
    };
    screening.dependences.iter().find(alike)
}

fn names(covariates: &[Covariate]) -> String {
    match covariates {
        [] => "nothing: its mean is off".into(),
        some => some.iter().map(|c| c.name().replace('_', " ")).collect::<Vec<_>>().join(" × "),
    }
}

/// The rounds.
pub(super) fn rounds(report: &Report) -> String {
    let mut out = String::new();
    for (i, round) in report.outcome.rounds.iter().enumerate() {
        let _ = write!(
            out,
            "<details{}><summary>Round {}: {}</summary>\n{}</details>\n",
            if i == 0 { " open" } else { "" },
            i + 1,
            escaped(&round.decision),
            candidates(round)
        );
    }
    if out.is_empty() {
        return out;
    }
    format!(
        "<section>\n<h2>Rounds</h2>\n<p>Every effect that the model lacks was fitted to a sample; those that could win, on one half of the scenes and scored on the \
         other, and the other way round. One that passes gains more likelihood than chance (q &lt; 0.05), more than a minimum, and keeps within plausible numbers; the best of them is also fitted to a placebo, the same scans with their residuals given to rays \
         drawn by lot, where it must gain less.</p>\n{out}</section>\n"
    )
}

fn candidates(round: &Round) -> String {
    let mut rows = String::new();
    for c in round.candidates.iter().take(CANDIDATES) {
        let (gain, ends) = interval(&c.gain_nats_per_pixel, nats);
        let _ = writeln!(
            rows,
            "<tr{}><th>{}</th><td><b>{gain}</b><small>{}</small></td><td>{}</td><td>{}</td></tr>",
            if c.passed { "" } else { " class=\"failed\"" },
            escaped(c.name.replace('_', " ")),
            if c.only_glanced { String::new() } else { ends },
            if c.only_glanced { "–".into() } else { chance(c.q_value) },
            match (c.passed, c.only_glanced, &c.placebo_gain) {
                (true, _, None) => "passes".into(),
                (true, _, Some(placebo)) => format!("passes<small>placebo {}</small>", nats(placebo.value)),
                (false, false, None) => "does not pass".into(),
                (false, false, Some(placebo)) =>
                    format!("as good as its placebo<small>{}</small>", nats(placebo.value)),
                (false, true, _) => String::from("sample only"),
            }
        );
    }
    let more = round.candidates.len().saturating_sub(CANDIDATES);
    let more = if more > 0 { format!("<p class=\"fine\">and {more} more that gain less</p>") } else { String::new() };
    format!(
        "<table class=\"numbers\"><thead><tr><th>candidate</th><th>gain, nats per thousand rays</th><th>q</th><th></th></tr></thead><tbody>\n{rows}</tbody></table>{more}\n"
    )
}

/// What could not be told.
pub(super) fn caveats(report: &Report) -> String {
    let caveats = &report.outcome.caveats;
    if caveats.is_empty() {
        return String::new();
    }
    let items = caveats.iter().map(|c| format!("<li>{}</li>\n", escaped(c))).collect::<Vec<_>>().concat();
    format!("<section>\n<h2>What this cannot say</h2>\n<ul>\n{items}</ul>\n</section>\n")
}

/// Where it comes from.
pub(super) fn provenance(report: &Report) -> String {
    let identity = &report.identity;
    format!(
        "<section>\n<h2>Models</h2>\n<table class=\"parameters\"><tbody><tr><th>before</th><td><code>{}</code></td></tr>\
         <tr><th>after</th><td><code>{}</code></td></tr></tbody></table>\n<p class=\"fine\">SHA-256 of the files. The same numbers for programs: \
         <code>report.json</code>.</p>\n</section>\n",
        escaped(&identity.before),
        escaped(&identity.after)
    )
}

fn sentence_case(name: &str) -> String {
    let name = name.replace('_', " ");
    let mut letters = name.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
