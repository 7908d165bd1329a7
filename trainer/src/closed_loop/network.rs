//! The network that generates what the effects of a model act on: an ONNX graph that is run on simulated scans, and exported in front
//! of the effects.

use anyhow::{Context, Result};
use burn::module::Module;
use burn::tensor::{Device, Tensor, s};
use lidar::{RangeImage, Sensor};
use onnx::{Axis, Composition, Exporter, base_of};
use ort::session::Session;
use ort::value::TensorRef;
use proto::card::{Card, tensor};

/// The tensors that a network gives, in the order of this program's functions.
pub(crate) const OUTPUTS: [&str; 3] = [tensor::RANGE, tensor::REFLECTANCE, tensor::KEEP];

/// Stands before the names of the inputs that take a network's outputs.
pub(crate) const GENERATED: &str = "generated_";

/// A network without noise, which says "range 0" on the rays that have no return.
#[derive(Clone, Debug)]
pub struct Network {
    onnx: Vec<u8>,
}

/// What a network makes of a scan.
#[derive(Clone, Debug)]
pub struct Generated {
    /// The scan, with the classes of the simulated one.
    pub image: RangeImage,
    /// Probability that each ray is reported.
    pub keep: Vec<f32>,
}

/// A graph without parameters.
#[derive(Module, Debug)]
struct Plain {}

impl Network {
    /// The network of an exported model without effects. Noise of its own is put at ½, for its spread is part of the residual that
    /// effects are fitted to; what it says of rays without a return counts only if the card says so.
    pub fn new(onnx: &[u8], card: &Card) -> Result<Self> {
        let size = [card.sensor.rings().len(), card.sensor.columns()];
        let silent = if card.noise_channels == 0 {
            onnx.to_vec()
        } else {
            let half = median_noise(size, card.noise_channels)?;
            Composition::new().wire(tensor::NOISE, tensor::NOISE).compose(&half, onnx)?
        };
        let wires = OUTPUTS.iter().fold(Composition::new(), |c, name| c.wire(name, &format!("{GENERATED}{name}")));
        Ok(Self { onnx: wires.compose(&silent, &told_returns(size, card.adds_returns)?)? })
    }

    /// The network in front of the effects of a model that calibrate wrote; `None` where there is none, the effects' input being the
    /// simulated scan.
    pub fn before_effects(onnx: &[u8]) -> Result<Option<Self>> {
        match base_of(onnx, &OUTPUTS) {
            Ok(onnx) => Ok(Some(Self { onnx })),
            Err(onnx::FileError::NoTensor { .. }) => Ok(None),
            Err(error) => Err(error).context("its effects cannot be taken off"),
        }
    }

    /// The bytes of its file.
    pub fn onnx(&self) -> &[u8] {
        &self.onnx
    }

    /// Runs it on simulated scans of a sensor.
    pub fn generate<'a>(
        &self,
        scans: impl IntoIterator<Item = &'a RangeImage>,
        sensor: &Sensor,
    ) -> Result<Vec<Generated>> {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let mut session = runtime::open(&runtime::environment()?, &self.onnx, threads)?;
        scans.into_iter().map(|scan| generate(&mut session, scan, sensor)).collect()
    }
}

fn generate(session: &mut Session, scan: &RangeImage, sensor: &Sensor) -> Result<Generated> {
    let mut input = vec![0.0; tensor::SCAN_CHANNELS * sensor.pixels()];
    scan.write_tensor(&mut input);
    let size = [1, tensor::SCAN_CHANNELS, sensor.rings().len(), sensor.columns()];
    let outputs = session.run(ort::inputs![tensor::SCAN => TensorRef::from_array_view((size, &*input))?])?;
    let mut images = Vec::with_capacity(OUTPUTS.len());
    for name in OUTPUTS {
        let (shape, values) = outputs[name].try_extract_tensor::<f32>()?;
        anyhow::ensure!(
            values.len() == sensor.pixels(),
            "output `{name}` has shape {shape:?}, one of {size:?} expected"
        );
        images.push(values.to_vec());
    }
    let [range_m, reflectance, keep]: [Vec<f32>; 3] =
        images.try_into().unwrap_or_else(|_| unreachable!("one image for each output"));
    let class = scan.class().to_vec();
    Ok(Generated { image: RangeImage::from_channels(sensor.columns(), range_m, reflectance, class), keep })
}

/// A graph that gives a network its noise: ½ everywhere.
fn median_noise([rings, columns]: [usize; 2], channels: usize) -> Result<Vec<u8>, onnx::Error> {
    let device = Device::flex();
    Exporter::new().input(tensor::SCAN).output(tensor::NOISE).dynamic(Axis::new("batch", 1).on(tensor::SCAN, 0)).export(
        &Plain {},
        |sizes| Tensor::<4>::zeros([sizes["batch"], tensor::SCAN_CHANNELS, rings, columns], &device),
        |_, scan| {
            let half = scan.slice(s![.., 0..1, .., ..]) * 0.0 + 0.5;
            Tensor::cat(vec![half; channels], 1)
        },
    )
}

/// A graph behind a network: "range 0" on rays without a return, everything else within its bounds.
fn told_returns([rings, columns]: [usize; 2], adds_returns: bool) -> Result<Vec<u8>, onnx::Error> {
    let device = Device::flex();
    let generated = |name: &&str| format!("{GENERATED}{name}");
    let inputs: Vec<String> = [tensor::SCAN.to_owned()].into_iter().chain(OUTPUTS.iter().map(generated)).collect();
    let exporter = inputs.iter().fold(Exporter::new(), |exporter, name| exporter.input(name));
    let exporter = OUTPUTS.iter().fold(exporter, |exporter, name| exporter.output(name));
    let batch = inputs.iter().fold(Axis::new("batch", 1), |axis, name| axis.on(name, 0));
    exporter.dynamic(batch).export(
        &Plain {},
        |sizes| {
            let image = |channels| Tensor::<4>::zeros([sizes["batch"], channels, rings, columns], &device);
            (image(tensor::SCAN_CHANNELS), image(1), image(1), image(1))
        },
        |_, (scan, range_m, reflectance, keep)| {
            let mut hit = range_m.clone().greater_elem(0.0).float();
            if !adds_returns {
                hit = hit * scan.slice(s![.., 0..1, .., ..]).greater_elem(0.0).float();
            }
            let none = hit.lower_elem(0.5);
            (
                range_m.mask_fill(none.clone(), 0.0),
                reflectance.clamp(0.0, 1.0).mask_fill(none.clone(), 0.0),
                keep.clamp(0.0, 1.0).mask_fill(none, 1.0),
            )
        },
    )
}
