//! `report.html`: the page around the sections.

use std::fmt::Display;

use super::section;
use super::{Report, Verdict};

const STYLE: &str = include_str!("style.css");

/// What stands above the sections, and around them.
pub(in crate::closed_loop) struct Page<'a> {
    /// What was done.
    pub(in crate::closed_loop) kicker: &'a str,
    /// What of.
    pub(in crate::closed_loop) title: String,
    /// On what.
    pub(in crate::closed_loop) subtitle: String,
    /// What it came to.
    pub(in crate::closed_loop) verdict: Verdict,
    /// The same in a few words.
    pub(in crate::closed_loop) headline: &'a str,
    /// The answer in sentences.
    pub(in crate::closed_loop) sentences: Vec<&'a str>,
    /// Everything else, as HTML.
    pub(in crate::closed_loop) sections: Vec<String>,
}

impl Page<'_> {
    /// One file; it needs no other and no script.
    pub(in crate::closed_loop) fn html(&self) -> String {
        let class = match self.verdict {
            Verdict::NothingMissing => "good",
            Verdict::EffectsAdded => "added",
            Verdict::UnexplainedOnly => "open",
        };
        let sentences = self.sentences.iter().map(|line| format!("<p>{}</p>", escaped(line))).collect::<Vec<_>>();
        format!(
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
<p class="kicker">Realbeam · {kicker}</p>
<h1>{title}</h1>
<p class="subtitle">{subtitle}</p>
</header>
<main>
<section class="verdict {class}">
<h2>{headline}</h2>
{sentences}
</section>
{sections}
</main>
</body>
</html>
"#,
            kicker = self.kicker,
            title = escaped(&self.title),
            subtitle = escaped(&self.subtitle),
            headline = self.headline,
            sentences = sentences.concat(),
            sections = self.sections.concat(),
        )
    }
}

/// The report's page.
pub(super) fn page(report: &Report) -> anyhow::Result<String> {
    let identity = &report.identity;
    let [discover, tune, confirm] = identity.frames;
    let words = report.words();
    let page = Page {
        kicker: "closed loop",
        title: format!("{}: what its model lacks", identity.sensor),
        subtitle: format!(
            "Set {} · {discover} frames to discover, {tune} to tune, {confirm} to confirm · seed {}",
            identity.set, identity.seed
        ),
        verdict: report.verdict(),
        headline: match report.verdict() {
            Verdict::NothingMissing => "Nothing is missing",
            Verdict::EffectsAdded => "Effects were missing and have been added",
            Verdict::UnexplainedOnly => "Something without a name is missing",
        },
        sentences: words.lines().filter(|line| !line.starts_with("Note: ")).collect(),
        sections: vec![
            section::metrics(report),
            section::effects(report),
            section::maps(report)?,
            section::view(report)?,
            section::unexplained(report),
            section::screening(report),
            section::rounds(report),
            section::caveats(report),
            section::provenance(report),
        ],
    };
    Ok(page.html())
}

/// Text that a browser shows as it is.
pub(in crate::closed_loop) fn escaped(text: impl Display) -> String {
    text.to_string().replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
