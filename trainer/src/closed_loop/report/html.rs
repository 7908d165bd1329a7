//! `report.html`: the page around the sections.

use std::fmt::Display;

use super::section;
use super::{Report, Verdict};

pub(in crate::closed_loop) const STYLE: &str = include_str!("style.css");

/// The whole page; it needs no other file and no script.
pub(super) fn page(report: &Report) -> anyhow::Result<String> {
    let identity = &report.identity;
    let title = escaped(format_args!("{}: what its model lacks", identity.sensor));
    let (class, verdict) = match report.verdict() {
        Verdict::NothingMissing => ("good", "Nothing is missing"),
        Verdict::EffectsAdded => ("added", "Effects were missing and have been added"),
        Verdict::UnexplainedOnly => ("open", "Something without a name is missing"),
    };
    let paragraphs = report
        .words()
        .lines()
        .filter(|line| !line.starts_with("Note: "))
        .map(|l| format!("<p>{}</p>", escaped(l)))
        .collect::<Vec<_>>();
    let sentences = paragraphs.concat();
    let sections = [
        section::metrics(report),
        section::effects(report),
        section::maps(report)?,
        section::view(report)?,
        section::unexplained(report),
        section::screening(report),
        section::rounds(report),
        section::caveats(report),
        section::provenance(report),
    ];
    Ok(format!(
        r#"<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
{STYLE}</style>
</head>
<body>
<header>
<p class="kicker">Realbeam · closed loop</p>
<h1>{title}</h1>
<p class="subtitle">Set {set} · {discover} frames to discover, {tune} to tune, {confirm} to confirm · seed {seed}</p>
</header>
<main>
<section class="verdict {class}">
<h2>{verdict}</h2>
{sentences}
</section>
{sections}
</main>
</body>
</html>
"#,
        set = escaped(&identity.set),
        discover = identity.frames[0],
        tune = identity.frames[1],
        confirm = identity.frames[2],
        seed = identity.seed,
        sections = sections.concat(),
    ))
}

/// Text that a browser shows as it is.
pub(in crate::closed_loop) fn escaped(text: impl Display) -> String {
    text.to_string().replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
