//! A tiny CLS2R, trained for two steps: its run becomes a model that the service's pipeline answers with.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use lidar::formats::{self, Format, Limits};
use lidar::{RangeImage, Sensor};
use proto::{Form, Frame};
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, cast};
use server::{Caller, Chance, Model, Pipeline, ScanJob};
use trainer::export;
use trainer::train::Run;
use trainer::translation::{TranslationConfig, train};

type Fact = Result<(), Box<dyn std::error::Error>>;

const COLUMNS: usize = 128;

fn scan(seed: u64, sensor: &Sensor) -> RangeImage {
    cast(&street(seed, &StreetConfig::default()), sensor, &Pose::default(), &Motion::default()).image
}

/// Streets for both domains: what is learned is of no interest here.
fn write_streets(root: &Path, sensor: &Sensor) -> Fact {
    for seed in 0..2 {
        formats::write(&root.join(format!("streets/{seed}.ply")), &scan(seed, sensor).to_cloud(sensor))?;
    }
    Ok(())
}

fn config() -> Result<TranslationConfig, Box<dyn std::error::Error>> {
    let mut text = format!(
        "name = \"toy\"\nsummary = \"A toy\"\nlicence = \"MIT\"\nsensor = \"vlp16\"\ncolumns = {}\nserved_columns = {COLUMNS}\nmethod = \"cls2r\"\n\
         [generator]\nwidth = 8\nblocks = 2\nrings = 16\n[discriminator]\nwidth = 8\nhalvings = 2\n[losses]\npatches = 16\n\
         [schedule]\nsteps = 2\nbatch = 1\ncrop_columns = 64\ncheckpoint_every = 2\nsamples_every = 0\n",
        COLUMNS / 2
    );
    for part in ["simulated.train", "simulated.validate", "simulated.test", "real.train", "real.validate", "real.test"]
    {
        writeln!(text, "[[{part}]]\npath = \"streets\"\ncolumns = {COLUMNS}\nsource = \"made up\"\nlicence = \"MIT\"")?;
    }
    Ok(TranslationConfig::from_table(toml::from_str(&text)?)?)
}

#[test]
fn a_translation_is_exported_and_served_like_any_other_model() -> Fact {
    let root = tempfile::tempdir()?;
    let sensor = Sensor::builtin("vlp16")?.with_columns(COLUMNS)?;
    std::fs::create_dir(root.path().join("streets"))?;
    write_streets(root.path(), &sensor)?;
    let run = Run { out: root.path().join("run"), data: root.path().into(), resume: false, stop_after: None };
    train(&config()?, &run)?;
    // Compared with Burn on the way, or this fails.
    let (onnx, card) = export::export(&run.out, root.path())?;
    let version = export::publish(&root.path().join("models"), &card, &onnx)?;
    assert!(version.ends_with("toy/1"));
    assert!(std::fs::read_to_string(version.join("card.md"))?.contains("lost rays, from real"));

    let sent = scan(9, &sensor).to_cloud(&sensor);
    let job = ScanJob {
        bytes: formats::encode(Format::Ply, &sent)?.into(),
        format: Format::Ply,
        answer: Form::Scan(Format::Ply),
        ring_counts: None,
        frame: Frame::Ros,
        chance: Chance { seed: 3, ..Chance::default() },
        limits: Limits::default(),
    };
    let model = Arc::new(Model::from_bytes(std::fs::read(version.join("model.onnx"))?)?);
    let answer =
        formats::decode(Format::Ply, &Pipeline::new(&model, 1)?.run(&job, Caller::PATIENT)?.bytes, &Limits::default())?;
    // Random weights keep about half of the rays.
    let share = answer.len() as f64 / sent.len() as f64;
    assert!((0.1..0.95).contains(&share), "{share} of the returns are left");
    assert!(
        (0..answer.len()).all(|i| (sensor.range_limits_m().0..=sensor.range_limits_m().1).contains(&answer.range_m(i)))
    );
    Ok(())
}
