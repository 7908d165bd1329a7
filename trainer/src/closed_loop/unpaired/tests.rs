//! What is hidden in the measured half of some streets is found against simulated scans of others, and nothing where nothing is hidden.

#![allow(clippy::unwrap_used, reason = "a test that panics is a test that fails")]

use hidden::{Defect, Recipe, Reflectance, Returns, frames};
use nalgebra::{DMatrix, DVector};

use super::*;
use crate::closed_loop::report::Verdict;
use crate::effects::library;

/// Measured scans of ten streets, simulated ones of ten others.
fn set(seed: u64, hidden: Vec<Defect>) -> UnpairedSet {
    let elevations_deg = (0..16).map(|ring| 4.0 - 1.5 * f64::from(ring));
    let sensor = Sensor::from_elevations_deg("small", elevations_deg, 256, (1.0, 80.0), 10.0).unwrap();
    let half = |seed: u64, hidden: Vec<Defect>, measured: bool| -> Vec<LoneScan> {
        let recipe = Recipe { scenes: 10, frames_per_scene: 2, ..Recipe::new(seed, sensor.clone(), hidden) };
        let scan = |(i, frame): (usize, hidden::HiddenFrame)| LoneScan {
            name: format!("{i:06}"),
            scene: frame.scene,
            image: if measured { frame.measured } else { frame.simulated },
            extra: 0,
        };
        frames(&recipe).into_iter().enumerate().map(scan).collect()
    };
    let scenes = |half: &str| (0..10).map(|i| format!("{half}-{i}")).collect();
    UnpairedSet {
        name: "streets".into(),
        rotation_hz: 10.0,
        simulated: half(1000 + seed, vec![], false),
        measured: half(seed, hidden, true),
        simulated_scenes: scenes("simulated"),
        measured_scenes: scenes("measured"),
        has_labels: true,
        notes: vec![],
        sha256: String::new(),
        sensor,
    }
}

fn names(finding: &Finding) -> Vec<&'static str> {
    finding.effects().iter().map(|found| found.term.name()).collect()
}

fn show(what: &str, finding: &Finding) {
    println!("{what}: {:?}, {:?}", names(finding), finding.noise);
    for p in &finding.tried.last().unwrap().curve.points {
        print!(" {:.1}:{:.3}/{:.3}", p.at, p.simulated.value, p.measured.value);
    }
    println!();
    for t in &finding.tried {
        println!(
            "  {:?}: gain {:.2e} [{:.1e}, {:.1e}], placebo {:.1e}, p {:.3}, q {:.3}, size {:.4}, share {:.4}, residual {:?}, {:?}",
            t.over,
            t.gain.value,
            t.gain.ci95[0],
            t.gain.ci95[1],
            t.placebo,
            t.p,
            t.q,
            t.size[0],
            t.share,
            t.residual,
            t.found.as_ref().map(|f| f.term.physical())
        );
    }
}

#[test]
fn nothing_is_missing_where_nothing_is() {
    let finding = compare(&set(1, vec![]), 1);
    show("nothing", &finding);
    assert_eq!(finding.verdict(), Verdict::NothingMissing);
    assert!((finding.noise.drop - 0.05).abs() < 0.01, "{:?}", finding.noise);
}

#[test]
fn ring_gains_are_named_and_measured() {
    let gain: Vec<f64> = (0..16).map(|ring| 1.0 + 0.2 * f64::from(ring * 5 % 7 - 3) / 3.0).collect();
    let hidden = Reflectance::RingGain { gain: gain.clone(), offset: vec![] };
    let finding = compare(&set(2, vec![hidden.into()]), 1);
    show("ring gain", &finding);
    assert_eq!(names(&finding), ["ring_gain"]);
    let found = finding.effects()[0].term.physical();
    let logs = |gains: &[f64]| gains.iter().map(|gain| gain.ln()).collect::<Vec<_>>();
    let error = (rough(&logs(&found[..16])) - rough(&logs(&gain))).norm() / 4.0;
    println!("rings are {error:.3} off");
    assert!(error < 0.06, "{found:?} for {gain:?}");
}

/// Numbers of evenly spaced rings less what is a cubic over them.
fn rough(of: &[f64]) -> DVector<f64> {
    let n = of.len();
    let powers = DMatrix::from_fn(n, 4, |ring, power| (2.0 * ring as f64 / (n - 1) as f64 - 1.0).powi(power as i32));
    let of = DVector::from_column_slice(of);
    let smooth = &powers * (powers.transpose() * &powers).try_inverse().unwrap() * powers.transpose() * &of;
    of - smooth
}

#[test]
fn fading_with_range_is_named_and_measured() {
    let hidden = Reflectance::ReflectanceFalloff { beta_per_m: 0.02, overlap_m: 0.0 };
    let set = set(3, vec![hidden.into()]);
    let finding = compare(&set, 1);
    show("falloff", &finding);
    assert_eq!(names(&finding), ["reflectance_falloff"]);
    let beta_per_m = finding.effects()[0].term.physical()[0];
    assert!((beta_per_m - 0.02).abs() < 0.006, "{beta_per_m} per m");

    let delivery = UnpairedDelivery::new(&set, finding, 1).unwrap();
    let report: serde_json::Value = serde_json::from_str(&delivery.report.json().unwrap()).unwrap();
    assert_eq!((&report["mode"], &report["verdict"]), (&"unpaired".into(), &"effects_added".into()));
    assert_eq!(report["effects"][0]["parameters"]["beta_per_m"]["value"], beta_per_m);
    assert_eq!(report["cannot_be_seen"].as_array().map(Vec::len), Some(CANNOT_BE_SEEN.len()));
    let page = delivery.report.html();
    assert_eq!(page.matches("<svg").count(), Over::COUNT);
    assert!(!page.contains("http") && !page.contains("<script"), "a page that needs no other file");
    // The model opens, and what it declares is what was found.
    assert!(runtime::open(&runtime::environment().unwrap(), &delivery.onnx, 1).is_ok());
    let declared: Vec<&str> = delivery.card.effects.iter().map(|effect| effect.name.as_str()).collect();
    assert_eq!(declared, ["noise_floor", "reflectance_falloff"]);
}

#[test]
fn weak_returns_that_are_lost_are_named_and_their_power_measured() {
    let hidden = Returns::WeakReturnDrop { p_min_per_m2: 3e-5, softness: 0.5, beta_per_m: 0.0 };
    let finding = compare(&set(4, vec![hidden.into()]), 1);
    show("weak", &finding);
    assert_eq!(names(&finding), ["weak_return_drop"]);
    // Half of the returns are lost where no neighbours return to tell: what is measured is where a tenth is.
    let tenth = |log_p_min: f64, softness: f64| log_p_min + detection::TENTH * softness;
    let found = finding.effects()[0].term.physical();
    let off = tenth(found[0].ln(), found[1]) - tenth(3e-5_f64.ln(), 0.5);
    println!("the power at which a tenth is lost is e^{off:.2} off");
    assert!(off.abs() < 0.5, "{found:?}");
}

#[test]
fn every_effect_of_the_library_is_either_tried_or_said_to_be_out_of_sight() {
    let mut told: Vec<&str> =
        CANNOT_BE_SEEN.iter().map(|unseen| unseen.name).chain(Over::ALL.map(Over::effect)).collect();
    let mut known: Vec<&str> = library().iter().map(|effect| effect.about().name).collect();
    told.sort_unstable();
    known.sort_unstable();
    assert_eq!(told, known);
}

/// What is named in each of so many sets, and in how many it is that: `cargo test --release --lib -- --ignored --nocapture unpaired`.
fn in_many(sets: u64, hidden: &[Defect], expected: &[&str]) -> usize {
    let mut right = 0;
    for seed in 0..sets {
        let finding = compare(&set(100 + seed, hidden.to_vec()), seed);
        show(&format!("{hidden:?}, set {seed}"), &finding);
        right += usize::from(names(&finding) == expected);
    }
    println!("{hidden:?}: {expected:?} in {right} of {sets}");
    right
}

#[test]
#[ignore = "minutes"]
fn in_many_sets_with_nothing_hidden_there_are_few_false_alarms() {
    assert!(in_many(40, &[], &[]) >= 36);
}

#[test]
#[ignore = "minutes"]
fn in_many_sets_ring_gains_are_named() {
    let gain = (0..16).map(|ring| 1.0 + 0.1 * f64::from(ring * 5 % 7 - 3) / 2.0).collect();
    assert!(in_many(8, &[Reflectance::RingGain { gain, offset: vec![] }.into()], &["ring_gain"]) >= 7);
}

#[test]
#[ignore = "minutes"]
fn in_many_sets_fading_is_named() {
    for (beta_per_m, overlap_m) in [(0.01, 0.0), (0.005, 6.0)] {
        let hidden = Reflectance::ReflectanceFalloff { beta_per_m, overlap_m };
        assert!(in_many(8, &[hidden.into()], &["reflectance_falloff"]) >= 7);
    }
}

#[test]
#[ignore = "minutes"]
fn in_many_sets_the_angle_is_named() {
    let hidden = Reflectance::IncidenceFalloff { exponent: 0.5 };
    assert!(in_many(8, &[hidden.into()], &["incidence_falloff"]) >= 5);
}

#[test]
#[ignore = "minutes"]
fn in_many_sets_lost_weak_returns_are_named() {
    let named = [1.5e-5, 3e-5].map(|p_min_per_m2| {
        let hidden = Returns::WeakReturnDrop { p_min_per_m2, softness: 0.5, beta_per_m: 0.0 };
        in_many(8, &[hidden.into()], &["weak_return_drop"])
    });
    assert!(named[1] >= 5);
}
