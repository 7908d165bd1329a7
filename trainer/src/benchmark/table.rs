//! The benchmark's tables, in Markdown.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::judge::Judgement;
use super::row::Row;
use super::share::{Share, size_found};
use super::suite::Suite;

/// A row with its judgement.
type Judged<'a> = (&'a Row, Judgement);

/// Every suite that has rows, summary first.
pub fn table(rows: &[Row]) -> String {
    let judged: Vec<Judged<'_>> = rows.iter().map(|row| (row, Judgement::of(row))).collect();
    let of = |suite: Suite| judged.iter().filter(|(row, _)| row.case.suite == suite).collect::<Vec<_>>();
    let suites: Vec<(Suite, Vec<&Judged<'_>>)> =
        Suite::ALL.into_iter().map(|suite| (suite, of(suite))).filter(|(_, rows)| !rows.is_empty()).collect();

    let mut text = String::new();
    let summary = suites.iter().filter(|(suite, _)| *suite != Suite::Size).map(|(suite, rows)| summary(*suite, rows));
    write(&mut text, "All", SUMMARY, &summary.collect::<Vec<_>>());
    for (suite, rows) in &suites {
        match suite {
            Suite::Single => {
                let lines = by_label(rows).into_iter().map(|(label, rows)| named(label, &rows));
                write(&mut text, "One defect of the library, by name", NAMED, &lines.collect::<Vec<_>>());
                write(&mut text, "Its numbers", NUMBERS, &numbers(rows));
            }
            Suite::Pairs => {
                let lines = by_label(rows).into_iter().map(|(label, rows)| named(label, &rows));
                write(&mut text, "Two defects", NAMED, &lines.collect::<Vec<_>>());
            }
            Suite::Unknown => {
                let lines = by_label(rows).into_iter().map(|(label, rows)| named(label, &rows));
                write(&mut text, "A defect that the library does not have", NAMED, &lines.collect::<Vec<_>>());
            }
            Suite::Nothing => {}
            Suite::Size => {
                let sizes = sizes(rows);
                let header: Vec<String> = ["defect".to_owned()]
                    .into_iter()
                    .chain(sizes.iter().map(|size| format!("× {size}")))
                    .chain(["half at".to_owned(), "95 % at".to_owned()])
                    .collect();
                let header: Vec<&str> = header.iter().map(String::as_str).collect();
                let lines = by_label(rows).into_iter().map(|(label, rows)| curve(label, &rows, &sizes));
                write(&mut text, "Found, by size", &header, &lines.collect::<Vec<_>>());
            }
        }
    }
    text
}

const SUMMARY: &[&str] =
    &["suite", "sets", "right", "or tied", "within 10 %", "covered", "false names a set", "error removed", "s a set"];

const NAMED: &[&str] = &["hidden", "right", "or tied", "false names a set", "error removed", "said instead", "s a set"];

const NUMBERS: &[&str] = &["hidden", "quantity", "within 10 %", "median error", "covered"];

fn summary(suite: Suite, rows: &[&Judged<'_>]) -> Vec<String> {
    let quantities = || rows.iter().flat_map(|(_, judged)| &judged.quantities).map(|(_, quantity)| quantity);
    vec![
        suite.name().into(),
        rows.len().to_string(),
        Share::count(rows.iter().map(|(_, judged)| judged.right)).to_string(),
        Share::count(rows.iter().map(|(_, judged)| judged.right_or_tied)).to_string(),
        Share::count(quantities().map(super::Quantity::is_within)).to_string(),
        Share::count(quantities().flat_map(super::Quantity::covered)).to_string(),
        false_names(rows),
        removed(rows),
        seconds(rows),
    ]
}

fn named(label: String, rows: &[&Judged<'_>]) -> Vec<String> {
    vec![
        label,
        Share::count(rows.iter().map(|(_, judged)| judged.right)).to_string(),
        Share::count(rows.iter().map(|(_, judged)| judged.right_or_tied)).to_string(),
        false_names(rows),
        removed(rows),
        instead(rows),
        seconds(rows),
    ]
}

/// A line for each quantity of each defect.
fn numbers(rows: &[&Judged<'_>]) -> Vec<Vec<String>> {
    let mut of: BTreeMap<(&str, &str), Vec<&super::Quantity>> = BTreeMap::new();
    for (name, quantity) in rows.iter().flat_map(|(_, judged)| &judged.quantities) {
        of.entry((name, quantity.name)).or_default().push(quantity);
    }
    let line = |((name, quantity), all): ((&str, &str), Vec<&super::Quantity>)| {
        // A tenth of the truth is an error of 1.
        let mut errors: Vec<f64> = all.iter().map(|q| 10.0 * q.error()).collect();
        errors.sort_by(f64::total_cmp);
        vec![
            name.to_owned(),
            quantity.to_owned(),
            Share::count(all.iter().map(|q| q.is_within())).to_string(),
            format!("{:.1} %", errors[errors.len() / 2]),
            Share::count(all.iter().flat_map(|q| q.covered())).to_string(),
        ]
    };
    of.into_iter().map(line).collect()
}

fn curve(label: String, rows: &[&Judged<'_>], sizes: &[f64]) -> Vec<String> {
    let at = |size: &f64| {
        let of_size = rows.iter().filter(|(row, _)| row.case.size == *size);
        (*size, Share::count(of_size.map(|(_, judged)| judged.right)))
    };
    let curve: Vec<(f64, Share)> = sizes.iter().map(at).filter(|(_, share)| share.of > 0).collect();
    let shares = sizes.iter().map(|size| at(size).1).map(|share| format!("{} of {}", share.yes, share.of));
    let sizes_found =
        [0.5, 0.95].map(|level| size_found(&curve, level).map_or("–".into(), |size| format!("{size:.2}")));
    [label].into_iter().chain(shares).chain(sizes_found).collect()
}

fn sizes(rows: &[&Judged<'_>]) -> Vec<f64> {
    let mut sizes: Vec<f64> = rows.iter().map(|(row, _)| row.case.size).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.dedup();
    sizes
}

fn by_label<'a>(rows: &[&'a Judged<'a>]) -> BTreeMap<String, Vec<&'a Judged<'a>>> {
    let mut of: BTreeMap<String, Vec<&Judged<'_>>> = BTreeMap::new();
    for judged in rows {
        of.entry(judged.0.case.label()).or_default().push(judged);
    }
    of
}

/// What wrong answers began with, the most frequent first.
fn instead(rows: &[&Judged<'_>]) -> String {
    let mut of: BTreeMap<&str, usize> = BTreeMap::new();
    for (_, judged) in rows.iter().filter(|(_, judged)| !judged.right) {
        *of.entry(&judged.said).or_default() += 1;
    }
    let mut of: Vec<(&str, usize)> = of.into_iter().collect();
    of.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    of.into_iter().map(|(said, count)| format!("{said} × {count}")).collect::<Vec<_>>().join(", ")
}

fn false_names(rows: &[&Judged<'_>]) -> String {
    let all: usize = rows.iter().map(|(_, judged)| judged.false_names.len()).sum();
    format!("{:.2}", all as f64 / rows.len() as f64)
}

fn removed(rows: &[&Judged<'_>]) -> String {
    let mut shares: Vec<f64> = rows.iter().filter_map(|(_, judged)| judged.removed).collect();
    shares.sort_by(f64::total_cmp);
    shares.get(shares.len() / 2).map_or("–".into(), |median| format!("{:.0} %", 100.0 * median))
}

fn seconds(rows: &[&Judged<'_>]) -> String {
    format!("{:.1}", rows.iter().map(|(row, _)| row.seconds).sum::<f64>() / rows.len() as f64)
}

fn write(text: &mut String, title: &str, header: &[&str], lines: &[Vec<String>]) {
    if lines.is_empty() {
        return;
    }
    let row = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    // Writing into a string cannot fail.
    let _ = writeln!(text, "### {title}\n");
    text.push_str(&row(&header.iter().map(|cell| (*cell).to_owned()).collect::<Vec<_>>()));
    text.push_str(&row(&vec!["---".to_owned(); header.len()]));
    text.extend(lines.iter().map(|line| row(line)));
    text.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::benchmark::row::tests::{answer, row};

    #[test]
    fn a_table_says_what_was_right_and_what_was_said_instead() {
        let rows = [
            row(Suite::Single, &["range_walk"], answer(&[("range_walk", &[])], vec![])),
            row(Suite::Single, &["range_walk"], answer(&[("range_offset", &["range_walk"])], vec![])),
            row(Suite::Single, &["range_walk"], answer(&[], vec![])),
        ];
        let text = table(&rows);
        let line = text.lines().find(|line| line.starts_with("| range_walk")).unwrap_or_default();
        let expected = "| range_walk | 33 % (1 of 3, 6–79 %) | 67 % (2 of 3, 21–94 %) | 0.00 | – | nothing × 1, range_offset × 1 | 2.0 |";
        assert_eq!(line, expected, "{text}");
    }
}
