//! `report.html` of a comparison without twins.

use std::fmt::Write as _;

use super::words::sentence;
use super::{UnpairedReport, plot};
use crate::closed_loop::report::Verdict;
use crate::closed_loop::report::html::{Page, escaped};
use crate::closed_loop::report::numbers::{chance, digits, interval, percent, with_error};
use crate::closed_loop::unpaired::{CANNOT_BE_SEEN, Tried, Unseen};
use crate::effects::library;

/// Most numbers of a parameter that are written out: the curve shows more.
const WRITTEN_OUT: usize = 8;

/// The report's page.
pub(super) fn page(report: &UnpairedReport) -> String {
    let finding = &report.finding;
    let words = report.words();
    let is_shown_elsewhere = |line: &str| line.starts_with("Note: ") || line.starts_with("Scans of different places");
    let page = Page {
        kicker: "closed loop, unpaired",
        title: format!("{}: what its model lacks, seen without twins", report.sensor),
        subtitle: subtitle(report),
        verdict: finding.verdict(),
        headline: match finding.verdict() {
            Verdict::NothingMissing => "Nothing is missing of what can be seen",
            Verdict::EffectsAdded => "Effects were missing and have been added",
            Verdict::UnexplainedOnly => "Something without a name is missing",
        },
        sentences: words.lines().filter(|line| !is_shown_elsewhere(line)).collect(),
        sections: vec![
            table(report),
            finding.tried.iter().map(article).collect(),
            unseen(),
            caveats(report),
            provenance(report),
        ],
    };
    page.html()
}

fn subtitle(report: &UnpairedReport) -> String {
    let [simulated, measured] = report.finding.scenes;
    let [confirm_simulated, confirm_measured] = report.finding.confirm;
    format!(
        "{}: {measured} measured scenes ({} scans) against {simulated} simulated scenes of other places ({} scans); \
         {confirm_measured} and {confirm_simulated} of them were opened once, at the end · seed {}",
        report.set, report.scans[1], report.scans[0], report.seed
    )
}

fn table(report: &UnpairedReport) -> String {
    let mut rows = String::new();
    for tried in &report.finding.tried {
        let (gain, ends) = interval(&tried.gain, |nats| digits(nats * 1e3, 3));
        let residual = tried.residual.map_or("–".into(), |[a, b]| format!("{} → {}", digits(a, 4), digits(b, 4)));
        let _ = writeln!(
            rows,
            "<tr{}><th>{}</th><td><b>{gain}</b><small>{ends}</small></td><td>{}</td><td>{}</td><td>{}<small>at least {}</small></td><td>{}</td><td>{residual}</td></tr>",
            if tried.found.is_some() { "" } else { r#" class="failed""# },
            named(tried),
            digits(tried.placebo * 1e3, 3),
            chance(tried.q),
            digits(tried.size[0], 3),
            digits(tried.size[1], 2),
            percent(tried.share),
        );
    }
    format!(
        r#"<section>
<h2>What was tried</h2>
<p>Rays cannot be compared, so distributions are: returns of one class of surface in one direction, between rings, over range, over the angle
of incidence; and missing returns over the power that the surface around them lets expect. The gain says how much better each half's own
numbers predict its held-out scenes than the other half's. The placebo calls other scenes measured, at random; 95 % of its gains stay below
what is given. A claim gains more, beyond chance (q ≤ 0.05), is no smaller than the least size, and helps on the confirm scenes.</p>
<table class="numbers"><thead><tr><th></th><th>gain, nats per thousand cells</th><th>placebo</th><th>q</th><th>size</th><th>share of the scatter</th><th>scatter, confirm scenes</th></tr></thead>
<tbody>
{rows}</tbody></table>
</section>
"#
    )
}

fn article(tried: &Tried) -> String {
    let about = library().into_iter().map(|effect| effect.about()).find(|about| about.name == tried.over.effect());
    let (said, numbers) = match &tried.found {
        Some(effect) => (escaped(sentence(effect)), parameters(tried)),
        None if tried.unexplained.is_some() => {
            ("Returns are lost the more the less power is expected of them, but by no threshold.".into(), String::new())
        }
        None => ("Not claimed.".into(), String::new()),
    };
    let about = about.map_or(String::new(), |about| {
        format!("Formula: {}. Source: {}.", escaped(about.formula), escaped(about.source))
    });
    format!(
        "<section>\n<h2>{}</h2>\n<p>{said}</p>\n{numbers}<figure>\n{}\n<figcaption><span class=\"key with\">simulated scans</span> <span class=\"key without\">measured \
         scans</span>; bars are 95 % intervals over scenes</figcaption>\n</figure>\n<p class=\"fine\">{about}</p>\n</section>\n",
        named(tried),
        plot::curve(tried)
    )
}

fn parameters(tried: &Tried) -> String {
    let Some(found) = &tried.found else { return String::new() };
    let physical = found.term.physical();
    let mut rows = String::new();
    for (parameter, range) in found.term.layout() {
        // What has no error was not fitted.
        let known: Vec<usize> = range.filter(|i| found.stderr[*i].is_finite()).collect();
        let shown: Vec<String> = known.iter().map(|i| with_error(physical[*i], found.stderr[*i], "")).collect();
        if !shown.is_empty() && shown.len() <= WRITTEN_OUT {
            let _ = write!(rows, "<tr><th><code>{}</code></th><td>{}</td></tr>", parameter.name, shown.join(", "));
        }
    }
    format!("<table class=\"parameters\"><tbody>{rows}</tbody></table>\n")
}

fn named(tried: &Tried) -> String {
    let name = tried.over.effect().replace('_', " ");
    let mut letters = name.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

fn unseen() -> String {
    let row = |unseen: &Unseen| {
        format!("<tr><th>{}</th><td>{}</td></tr>\n", unseen.name.replace('_', " "), escaped(unseen.why))
    };
    let rows = CANNOT_BE_SEEN.iter().map(row).collect::<Vec<_>>().concat();
    format!(
        "<section>\n<h2>What cannot be seen without twins</h2>\n<table class=\"numbers\"><tbody>\n{rows}</tbody></table>\n</section>\n"
    )
}

fn caveats(report: &UnpairedReport) -> String {
    let item = |caveat: &String| format!("<li>{}.</li>\n", escaped(caveat));
    let items = report.finding.caveats.iter().map(item).collect::<Vec<_>>().concat();
    format!("<section>\n<h2>What to keep in mind</h2>\n<ul>\n{items}</ul>\n</section>\n")
}

fn provenance(report: &UnpairedReport) -> String {
    format!(
        "<section>\n<h2>Models</h2>\n<table class=\"parameters\"><tbody><tr><th>before</th><td><code>ideal</code></td></tr><tr><th>after</th>\
         <td><code>{}</code></td></tr></tbody></table>\n<p class=\"fine\">SHA-256 of the file. The same numbers for programs: <code>report.json</code>.</p>\n</section>\n",
        escaped(&report.after)
    )
}
