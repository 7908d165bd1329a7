//! An effect behind a model that exists already: one file, served like any other, and taken apart again.

use std::path::Path;
use std::sync::Arc;

use burn::tensor::{Device, Tensor};
use lidar::PointCloud;
use lidar::formats::{self, Format, Limits};
use onnx::{Axis, Composition, Exporter, base_of};
use proto::card::tensor::{KEEP, RANGE, REFLECTANCE};
use proto::card::{Card, METADATA_KEY};
use proto::{Form, Frame};
use server::{Caller, Chance, Model, Pipeline, ScanJob};
use tests::models;

type Fact = Result<(), Box<dyn std::error::Error>>;

/// A range offset of 10 cm, which leaves everything else alone.
#[derive(burn::module::Module, Debug)]
struct Offset {}

fn offset(rings: usize) -> Result<Vec<u8>, onnx::Error> {
    let device = Device::flex();
    let outputs = [RANGE, REFLECTANCE, KEEP];
    let exporter = outputs.into_iter().fold(Exporter::new(), |exporter, name| exporter.input(&format!("model_{name}")));
    let exporter = outputs.into_iter().fold(exporter, Exporter::output);
    let on_all = |axis: Axis, place| outputs.iter().fold(axis, |axis, name| axis.on(&format!("model_{name}"), place));
    exporter.dynamic(on_all(Axis::new("batch", 1), 0)).dynamic(on_all(Axis::new("column", 64), 3)).export(
        &Offset {},
        |sizes| {
            let image = || Tensor::<4>::zeros([sizes["batch"], 1, rings, sizes["column"]], &device);
            (image(), image(), image())
        },
        |_, (range, reflectance, keep)| (range + 0.1, reflectance, keep),
    )
}

fn composed(base: &[u8], card: &Card) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    let wired = [RANGE, REFLECTANCE, KEEP]
        .into_iter()
        .fold(Composition::new(), |composition, name| composition.wire(name, &format!("model_{name}")));
    let composition = wired.split("noise").metadata(METADATA_KEY, &card.to_json());
    Ok(composition.compose(base, &offset(card.sensor.rings().len())?)?)
}

fn answer(onnx: &[u8], scan: &Path) -> Result<PointCloud, Box<dyn std::error::Error>> {
    let job = ScanJob {
        bytes: std::fs::read(scan)?.into(),
        format: Format::Kitti,
        answer: Form::Scan(Format::Ply),
        ring_counts: None,
        frame: Frame::Ros,
        chance: Chance { seed: 3, ..Chance::default() },
        limits: Limits::default(),
    };
    let answer = Pipeline::new(&Arc::new(Model::from_bytes(onnx.to_vec())?), 1)?.run(&job, Caller::PATIENT)?;
    Ok(formats::decode(Format::Ply, &answer.bytes, &Limits::default())?)
}

fn an_offset_behind_it_moves_every_point_and_comes_off_again(file: &Path) -> Fact {
    let scan = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/hdl32e.bin");
    let base = std::fs::read(file)?;
    let whole = composed(&base, &Model::from_bytes(base.clone())?.card)?;
    let (before, after) = (answer(&base, &scan)?, answer(&whole, &scan)?);
    assert!(before.len() > 1000 && after.len() == before.len());
    assert!(after.intensity == before.intensity);
    for i in 0..before.len() {
        // The rounding of 100 m in single precision, through a handful of operations.
        assert!((after.range_m(i) - before.range_m(i) - 0.1).abs() < 1e-4, "point {i}");
    }
    assert!(answer(&base_of(&whole, &[RANGE, REFLECTANCE, KEEP])?, &scan)? == before);
    Ok(())
}

#[test]
fn a_shipped_model_takes_an_effect_behind_it() -> Fact {
    an_offset_behind_it_moves_every_point_and_comes_off_again(&models().join("hdl32e/3/model.onnx"))
}

#[test]
fn a_model_that_another_program_wrote_takes_an_effect_behind_it() -> Fact {
    let written_by_python = "../server/tests/data/models/hdl64e/1/model.onnx";
    an_offset_behind_it_moves_every_point_and_comes_off_again(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join(written_by_python),
    )
}
