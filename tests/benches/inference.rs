//! Time of the shipped models' own run at 1024 columns, on two threads.
// A bench has nobody to hand an error to.
#![allow(clippy::expect_used)]

use divan::Bencher;
use lidar::Sensor;
use ort::session::Session;
use ort::value::TensorRef;
use proto::card::{Card, METADATA_KEY, tensor};
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, cast};

const COLUMNS: usize = 1024;

fn main() {
    divan::main();
}

#[divan::bench(args = ["hdl64e/3", "hdl32e/3", "hdl64e-cls2r/4"])]
fn inference_at_1024_columns(bencher: Bencher<'_, '_>, model: &str) {
    let (mut session, rings, scan) = prepare(model).expect("the model runs");
    let metadata = session.metadata().expect("metadata").custom(METADATA_KEY).expect("a card");
    let channels = Card::from_json(&metadata).expect("a card").noise_channels;
    let noise = vec![0.3; channels * rings * COLUMNS];
    bencher.counter(divan::counter::ItemsCount::new(rings * COLUMNS)).bench_local(|| {
        let scan = TensorRef::from_array_view(([1, tensor::SCAN_CHANNELS, rings, COLUMNS], scan.as_slice()));
        let scan = scan.expect("a tensor of the scan's size");
        let mut inputs = ort::inputs![tensor::SCAN => scan];
        if channels > 0 {
            let noise = TensorRef::from_array_view(([1, channels, rings, COLUMNS], noise.as_slice()));
            inputs.push((tensor::NOISE.into(), noise.expect("a tensor of the noise's size").into()));
        }
        session.run(inputs).expect("the model runs").len()
    });
}

/// A session of a model, `name/version`, on two threads, its rings, and a street as its input.
fn prepare(model: &str) -> Result<(Session, usize, Vec<f32>), Box<dyn std::error::Error>> {
    let environment = runtime::environment()?;
    let path = tests::models().join(model).join("model.onnx");
    let session = Session::builder(&environment)?.with_intra_threads(2)?.commit_from_file(path)?;
    let sensor = Sensor::builtin(model.split(['-', '/']).next().unwrap_or(model))?.with_columns(COLUMNS)?;
    let image = cast(&street(3, &StreetConfig::default()), &sensor, &Pose::default(), &Motion::default()).image;
    let mut scan = vec![0.0; tensor::SCAN_CHANNELS * sensor.pixels()];
    image.write_tensor(&mut scan);
    Ok((session, sensor.rings().len(), scan))
}
