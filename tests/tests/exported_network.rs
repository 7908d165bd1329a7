//! An exported network in ONNX Runtime gives what Burn gives, at sizes that it was never traced at.

use burn::module::Module;
use burn::tensor::{Device, Distribution, Tensor, TensorData};
use ort::session::Session;
use ort::value::TensorRef;
use proto::card::{Card, tensor};
use trainer::network::UNetConfig;

type Fact = Result<(), Box<dyn std::error::Error>>;

/// Gives every weight, the norms' statistics included, a value that is not its initial one.
struct Scramble;

impl burn::module::ModuleMapper for Scramble {
    fn map_float<const D: usize>(
        &mut self,
        parameter: burn::module::Param<Tensor<D>>,
    ) -> burn::module::Param<Tensor<D>> {
        parameter.map(|t| t.clone() + t.random_like(Distribution::Uniform(0.0, 0.2)))
    }
}

fn card() -> Result<Card, Box<dyn std::error::Error>> {
    Ok(Card {
        schema: proto::card::SCHEMA,
        name: "toy".into(),
        summary: "A toy".into(),
        licence: "MIT".into(),
        sensor: lidar::Sensor::builtin("vlp16")?.with_columns(256)?,
        column_multiple: trainer::network::COLUMN_MULTIPLE,
        noise_channels: 0,
        adds_returns: false,
        drop_bursts: lidar::ray_drop::Bursts::default(),
        classes: vec![],
        effects: vec![],
        trained_on: vec![],
        scores: vec![],
        notes: String::new(),
    })
}

#[test]
fn onnx_runtime_agrees_with_burn_at_any_batch_and_width() -> Fact {
    let device = Device::flex();
    device.seed(5);
    let network = UNetConfig { channels: [16, 16, 32, 32] }.init(16, &device).map(&mut Scramble);
    let onnx = trainer::export::to_onnx(&network, &card()?)?;
    let environment = runtime::environment()?;
    let mut session = Session::builder(&environment)?.commit_from_memory(&onnx)?;
    for (batch, columns) in [(1, 256), (3, 128), (2, 40), (1, 1000)] {
        let uniform = |top: f64| Tensor::<4>::random([batch, 1, 16, columns], Distribution::Uniform(0.0, top), &device);
        // A third of the rays without a return; classes are whole numbers.
        let range = uniform(90.0).mask_fill(uniform(1.0).lower_elem(0.33), 0.0);
        let scan = Tensor::cat(vec![range, uniform(1.0), uniform(19.99).floor()], 1);
        let values: Vec<f32> = scan.to_data().iter::<f32>().collect();
        let outputs = session.run(ort::inputs![
            tensor::SCAN => TensorRef::from_array_view(([batch, 3, 16, columns], values.as_slice()))?
        ])?;
        let measured = network.forward(Tensor::from_data(TensorData::new(values, [batch, 3, 16, columns]), &device));
        // Ranges reach 95 m, the other two 1: float32 rounding through 14 convolutions stays below 2e-5 of that.
        for (name, burn, scale) in [
            (tensor::RANGE, measured.range_m, 95.0),
            (tensor::REFLECTANCE, measured.reflectance, 1.0),
            (tensor::KEEP, measured.keep, 1.0),
        ] {
            let (shape, found) = outputs[name].try_extract_tensor::<f32>()?;
            assert_eq!(**shape, [batch as i64, 1, 16, columns as i64]);
            let expected: Vec<f32> = burn.into_data().iter::<f32>().collect();
            let worst = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 2e-5 * scale, "{name} at {batch}×{columns}: {worst}");
            assert!(expected.iter().any(|v| *v != expected[0]), "{name} says something");
        }
    }
    Ok(())
}
