#![allow(clippy::expect_used, reason = "a test that panics is a test that fails")]

use std::path::PathBuf;
use std::sync::Arc;

use super::*;
use crate::closed_loop::metrics::{EdgeRays, METRICS, Metric};
use crate::closed_loop::model::{SensorModel, Term};
use crate::closed_loop::outcome::{Candidate, Found, Interval, Round, Unexplained};
use crate::closed_loop::screen::{Bin, Dependence, Map, Piece, Screening};
use crate::effects::{Channel, Covariate, library};

const RINGS: usize = 4;
const COLUMNS: usize = 8;

fn around(value: f64, half: f64) -> Interval {
    Interval { value, ci95: [value - half, value + half] }
}

fn effect(name: &str, physical: &[f64], stderr: Vec<f64>) -> Found {
    let effect = library().into_iter().find(|e| e.about().name == name).expect("an effect of the library");
    Found {
        term: Term::new(Arc::clone(&effect), RINGS).at(physical),
        stderr,
        gain: around(0.84, 0.06),
        q_value: 1e-9,
        ties: vec![],
    }
}

fn screening(share: f64) -> Screening {
    let curve = (0..RINGS)
        .map(|k| {
            let Interval { value: mean, ci95 } = around(share * k as f64, 0.01);
            Bin { from: k as f64, to: k as f64, mean, ci95, rays: 800 }
        })
        .collect();
    let dependence = Dependence {
        channel: Channel::Range,
        covariates: vec![Covariate::Ring],
        share,
        ci95: [share - 0.02, share + 0.02],
        p_value: 1e-6,
        q_value: 1e-5,
        curve,
    };
    let map = Map {
        channel: Channel::Range,
        columns: COLUMNS,
        mean: (0..RINGS * COLUMNS)
            .map(|i| if i == 3 { f32::NAN } else { share as f32 * (i as f32 / 16.0 - 1.0) })
            .collect(),
    };
    Screening { dependences: vec![dependence], maps: vec![map] }
}

/// A report as the loop would write it of a sensor whose rays point 0.21° higher than its model says.
fn report() -> Report {
    let offset = effect("elevation_offset", &[0.2134], vec![0.0049]);
    let mut after = SensorModel::ideal(RINGS);
    after.terms.push(offset.term.clone());
    let range =
        |before: f64, after: f64, ceiling: f64| (around(before, before / 20.0), around(after, after / 50.0), ceiling);
    let metrics = METRICS
        .iter()
        .map(|(name, _)| {
            let (before, after, ceiling) = match *name {
                "range_mae_m" => range(0.312, 0.0207, 0.0201),
                "range_rmse_m" => range(0.94, 0.027, 0.0252),
                "range_bias_m" => range(-0.21, 0.0003, 0.0),
                "keep_log_loss" => range(0.231, 0.199, 0.198),
                "keep_brier" => range(0.052, 0.0476, 0.0475),
                "reflectance_mae" => range(0.021, 0.0162, 0.016),
                "extra_returns_per_scan" => range(1.2, 1.3, 0.9),
                _ => range(0.29, 0.12, 0.115),
            };
            let drawn = (*name != "keep_log_loss").then(|| around(after.value * 1.4, after.value / 40.0));
            Metric { name, before, after, ceiling, drawn }
        })
        .collect();
    let candidate = |name: &str, gain: f64, q_value: f64, passed: bool| Candidate {
        name: name.into(),
        gain_nats_per_pixel: around(gain, 0.05),
        q_value,
        passed,
        placebo_gain: passed.then(|| around(0.01 * gain, 0.005)),
        only_glanced: false,
    };
    let pieces = (0..RINGS)
        .map(|k| Piece {
            from: k as f64,
            to: k as f64,
            without: around(0.1 * k as f64, 0.02),
            effect: 0.1 * k as f64,
            with: around(0.0, 0.01),
        })
        .collect();
    let scan = RangeImage::from_channels(COLUMNS, vec![12.0; 32], vec![0.4; 32], vec![0; 32]);
    Report {
        identity: Identity {
            set: "street".into(),
            sensor: "HDL-32 <roof>".into(),
            before: "ab".repeat(32),
            after: "cd".repeat(32),
            frames: [8, 8, 8],
            unseen: Unseen::Scenes,
            seed: 7,
        },
        outcome: Outcome {
            before: SensorModel::ideal(RINGS),
            after,
            rounds: vec![
                Round {
                    candidates: vec![
                        candidate("elevation_offset", 0.84, 1e-9, true),
                        candidate("fog", -0.001, 0.9, false),
                    ],
                    decision: "add elevation_offset".into(),
                },
                Round {
                    candidates: vec![candidate("fog", -0.001, 0.8, false)],
                    decision: "nothing passes: stop".into(),
                },
            ],
            effects: vec![offset],
            declared: vec![],
            unexplained: vec![],
            screening_before: screening(0.4),
            screening_after: screening(0.001),
            caveats: vec![],
        },
        confirmation: Confirmation {
            metrics,
            got_worse: vec![],
            edge_rays: EdgeRays { share: 0.021, before_mae_m: 2.4, after_mae_m: 1.9 },
            unexplained_returns_per_scan: 1.25,
        },
        curves: vec![EffectCurve {
            effect: "elevation_offset".into(),
            channel: Channel::Range,
            covariate: Covariate::Ring,
            pieces,
        }],
        view: Some(View { frame: 16, simulated: scan.clone(), measured: scan.clone(), predicted: scan }),
    }
}

/// Compares with the file; `UPDATE_SNAPSHOTS=1` writes it.
fn is_as_in(name: &str, text: &str) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("src/closed_loop/report/snapshots").join(name);
    if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
        std::fs::write(&path, text).expect("a folder to write to");
    }
    let expected = std::fs::read_to_string(&path).expect("a snapshot");
    assert!(text == expected, "{name} has changed (UPDATE_SNAPSHOTS=1 accepts this):\n{text}");
}

#[test]
fn the_document_is_as_other_programs_know_it() {
    is_as_in("report.json", &report().json().expect("a document"));
}

#[test]
fn the_answer_is_in_plain_words() {
    let words = report().words();
    assert_eq!(
        words,
        "The sensor points its rays 0.21° ± 0.01° higher than the model says.\n\
         Adding it takes the range error on scenes never seen before from 31 cm to 2.1 cm (ceiling 2.0 cm).\n\
         Nothing else is missing."
    );
}

#[test]
fn every_kind_of_answer_has_its_words() {
    let mut several = report();
    let gains = [0.8, 0.92, 1.1, 1.25, 0.0, 0.0, 0.01, -0.01];
    several.outcome.effects.push(Found { ties: vec!["fog".into()], ..effect("ring_gain", &gains, vec![0.01; 8]) });
    several.outcome.declared.push(effect("random_returns", &[0.0021], vec![0.0001]));
    several.outcome.unexplained.push(Unexplained {
        channel: Channel::Missing,
        covariates: vec!["azimuth".into(), "ring".into()],
        share_of_residual: 0.123,
        q_value: 1e-4,
        added_as_table: true,
    });
    several.outcome.caveats.push("2 of at least three scenes".into());
    several.confirmation.got_worse.push("chamfer_m");
    several.identity.unseen = Unseen::Frames;
    let mut nothing = report();
    nothing.outcome.effects.clear();
    let mut open = report();
    open.outcome.effects.clear();
    open.outcome.unexplained.push(Unexplained {
        channel: Channel::Range,
        covariates: vec!["sweep_phase".into()],
        share_of_residual: 0.41,
        q_value: 1e-4,
        added_as_table: false,
    });
    let mut unfinished = report();
    unfinished.outcome.unexplained = open.outcome.unexplained.clone();
    let verdicts = [&several, &nothing, &open].map(Report::verdict);
    assert_eq!(verdicts, [Verdict::EffectsAdded, Verdict::NothingMissing, Verdict::UnexplainedOnly]);
    is_as_in("words.txt", &[&several, &nothing, &open, &unfinished].map(Report::words).join("\n\n"));
}

#[test]
fn the_page_is_whole_and_needs_nothing_else() {
    let page = report().html().expect("a page");
    for part in [
        "HDL-32 &lt;roof&gt;",
        "0.21° ± 0.01°",
        "<svg",
        "data:image/png;base64,",
        "Errors on the confirm frames",
        "Residual maps",
        "Screening",
        "Round 2: nothing passes: stop",
        &"cd".repeat(32),
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("<script") && !page.contains("http"), "nothing is fetched");
    let (mut open, mut rest) = (Vec::new(), page.as_str());
    // Every element that is opened is closed, in order.
    while let Some(at) = rest.find('<') {
        rest = &rest[at + 1..];
        let (tag, after) = rest.split_once('>').expect("a tag ends");
        rest = after;
        let name = tag.trim_start_matches('/').split_whitespace().next().unwrap_or("").to_owned();
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "before {after:.60}");
        } else if !(tag.ends_with('/') || tag.starts_with('!') || ["meta", "img", "br"].contains(&name.as_str())) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "{open:?}");
}

#[test]
fn both_files_are_written() -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    report().write(folder.path())?;
    let names: std::collections::BTreeSet<_> =
        std::fs::read_dir(folder.path())?.map(|e| e.map(|e| e.file_name())).collect::<Result<_, _>>()?;
    assert_eq!(names.into_iter().collect::<Vec<_>>(), ["report.html", "report.json"]);
    Ok(())
}
