//! The loop closes through the served model: what a calibration found on some streets, `convert` puts into the scans of others.

use std::path::Path;
use std::process::Command;

use burn::tensor::Device;
use hidden::{Geometry, Recipe};
use lidar::formats::{self, Limits};
use lidar::{Projector, RangeImage, Sensor};
use tests::binary;
use trainer::closed_loop::base::Base;
use trainer::closed_loop::calibrate::calibrate;
use trainer::closed_loop::data::{Batch, Pair, batches};
use trainer::closed_loop::delivery::Delivery;
use trainer::closed_loop::metrics::of_scans;
use trainer::closed_loop::model::Term;
use trainer::closed_loop::outcome::Interval;
use trainer::sets::PairedSet;

type Fact = Result<(), Box<dyn std::error::Error>>;
type Maybe<T> = Result<T, Box<dyn std::error::Error>>;

const OFFSET_DEG: f64 = 0.3;

/// Streets of the set that is calibrated on, a frame each; those after them are never seen.
const SEEN: usize = 10;

fn recipe(scenes: usize) -> Maybe<Recipe> {
    let elevations_deg = (0..24).map(|k| 3.0 - k as f64);
    let sensor = Sensor::from_elevations_deg("small", elevations_deg, 256, (1.0, 100.0), 10.0)?;
    let hidden = vec![Geometry::ElevationOffset { offset_deg: OFFSET_DEG }.into()];
    Ok(Recipe { scenes, frames_per_scene: 1, ..Recipe::new(5, sensor, hidden) })
}

fn succeed(command: &mut Command) -> Maybe<String> {
    let output = command.output()?;
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    if output.status.success() { Ok(said) } else { Err(format!("{command:?}: {said}").into()) }
}

fn run_calibrate(set: &Path, model: &str, out: &Path) -> Maybe<String> {
    let mut command = Command::new(binary("realbeam-trainer")?);
    succeed(command.arg("calibrate").arg(set).args(["--model", model, "--out"]).arg(out))
}

fn image(path: &Path, sensor: &Sensor) -> Maybe<RangeImage> {
    Ok(Projector::new(sensor).project(&formats::read(path, &Limits::default())?)?.image)
}

fn names(terms: &[Term]) -> Vec<&str> {
    terms.iter().map(Term::name).collect()
}

/// Two numbers with 95 % intervals over a few streets each are one, if they differ by no more than both intervals' half-widths; three
/// streets can by chance be so alike that their interval says nothing, so 3 % are granted.
fn agree(a: Interval, b: Interval) -> bool {
    let half = |x: Interval| (x.ci95[1] - x.ci95[0]) / 2.0;
    (a.value - b.value).abs() <= half(a) + half(b) + 0.03 * a.value
}

#[test]
fn streets_never_seen_come_out_of_the_server_as_well_as_the_report_says() -> Fact {
    let root = tempfile::tempdir()?;
    let at = |name: &str| root.path().join(name);
    hidden::write(&recipe(SEEN)?, &at("set"))?;
    hidden::write(&recipe(SEEN + 5)?, &at("more"))?;

    let set = PairedSet::read(&at("set"))?;
    let base = Base::ideal(&set.sensor);
    let calibration = calibrate(&set, &base.pairs(&set)?, &base.declared, 0, &|_| {});
    let delivery = Delivery::new(&set, &base, calibration, 0)?;
    // As version 1 of a model of a repository.
    delivery.write(&at("models/small/1"))?;
    let report = &delivery.report;
    let found = names(report.outcome.after.effects());
    assert_eq!(found.first(), Some(&"elevation_offset"), "{}", report.words());
    let found_deg = report.outcome.after.effects()[0].physical()[0];
    assert!((found_deg - OFFSET_DEG).abs() < 0.02, "{found_deg}°");

    let unseen = PairedSet::read(&at("more"))?;
    let pairs = base.pairs(&unseen)?;
    let pairs: Vec<&Pair> = pairs.iter().filter(|pair| pair.scene >= SEEN).collect();
    assert_eq!(pairs.len(), 5);
    let unseen_batches = batches(&pairs, &unseen.sensor, &Device::flex());
    let unseen_batches: Vec<&Batch> = unseen_batches.iter().collect();
    for noise in ["median", "drawn"] {
        let mut served = Vec::new();
        for pair in &pairs {
            let name = &unseen.frames[pair.frame].name;
            let (from, to) = (at(&format!("more/sim/{name}.ply")), at(&format!("{noise}-{name}.ply")));
            let mut convert = Command::new(binary("realbeam-server")?);
            let seed = (3 + pair.frame).to_string();
            convert.args(["convert", "--model", "small", "--noise", noise, "--seed", &seed, "--models"]);
            succeed(convert.arg(at("models")).args([&from, &to]))?;
            served.push(image(&to, &set.sensor)?);
        }
        let models = [&report.outcome.before, &report.outcome.after];
        let of_served = of_scans(&served, models, &unseen_batches, 0);
        for name in ["range_mae_m", "reflectance_mae"] {
            let metric = report.confirmation.of(name).ok_or(name)?;
            let promised = if noise == "median" { metric.after } else { metric.drawn.ok_or("drawn")? };
            let (_, served) = of_served.iter().find(|(n, _)| *n == name).ok_or(name)?;
            eprintln!("{noise} {name}: before {:?}\n  promised {promised:?}\n  served {served:?}", metric.before);
            assert!(agree(promised, *served), "{noise} {name}: {served:?} served, {promised:?} promised");
        }
        let before = report.confirmation.of("range_mae_m").ok_or("range_mae_m")?.before.value;
        let (_, served) = of_served.iter().find(|(n, _)| *n == "range_mae_m").ok_or("range_mae_m")?;
        assert!(served.value < 0.5 * before, "{noise}: {} m of {before} m are left", served.value);
    }

    // What a model has is declared: on other scans it is refitted, and not found again. Through the command line.
    hidden::write(&Recipe { seed: 6, ..recipe(4)? }, &at("other"))?;
    let said = run_calibrate(&at("other"), &at("models/small/1/model.onnx").to_string_lossy(), &at("again"))?;
    let again = Base::read(&at("again/model.onnx"), &set.sensor)?;
    assert!(names(again.declared.effects()).starts_with(&found), "{:?}, {said}", names(again.declared.effects()));
    let refitted_deg = again.declared.effects()[0].physical()[0];
    assert!(refitted_deg != found_deg && (refitted_deg - OFFSET_DEG).abs() < 0.03, "{refitted_deg}°");
    let card = again.file.ok_or("a file")?.card;
    let declared = format!("that were refitted: {}. Effects that were found: ", found.join(", "));
    assert!(card.notes.contains(&declared), "{}", card.notes);
    assert_eq!(card.trained_on.len(), 2, "both sets");
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(at("again/report.json"))?)?;
    assert_eq!(json["model"]["before"], delivery.report.identity.after.as_str(), "the model that it began with");
    for file in ["report.html", "card.md"] {
        assert!(std::fs::metadata(at("again").join(file))?.len() > 0, "{file}");
    }
    Ok(())
}

#[test]
fn a_folder_with_something_else_in_it_is_left_alone() -> Fact {
    let root = tempfile::tempdir()?;
    std::fs::write(root.path().join("thesis.tex"), "ten years")?;
    let refused = run_calibrate(&root.path().join("no-set"), "ideal", root.path()).map_err(|e| e.to_string());
    assert!(refused.is_err_and(|e| e.contains("`thesis.tex`")));
    Ok(())
}
