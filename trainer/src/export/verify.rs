//! What ONNX Runtime makes of an exported network is what Burn makes of it, or it is not published.

use anyhow::{Result, ensure};
use burn::tensor::{Device, Tensor, TensorData};
use ort::value::TensorRef;
use proto::card::{Card, tensor};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::generator::Generator;

/// Largest difference, as a share of the farthest range, of a reflectance or of a probability: the rounding of float32 through some
/// dozens of convolutions.
const TOLERANCE: f32 = 1e-4;

/// Share of rays whose answers may differ by more: on a few, an answer hangs on which side of a threshold it falls.
const FLIPPED: f64 = 1e-4;

/// Multiples of the card's column multiple that networks are compared at, beside the sensor's whole turn, and scans at once.
const COMPARED: [(usize, usize); 2] = [(1, 40), (2, 24)];

/// Compares the two on scans made of random numbers, at several sizes.
pub(super) fn agrees(network: &impl Generator, onnx: &[u8], card: &Card) -> Result<()> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut session = runtime::open(&runtime::environment()?, onnx, threads)?;
    let (rings, device) = (card.sensor.rings().len(), Device::flex());
    let (_, far_m) = card.sensor.range_limits_m();
    let sizes = COMPARED.map(|(batch, multiples)| (batch, multiples * card.column_multiple));
    for (batch, columns) in sizes.into_iter().chain([(1, card.sensor.columns())]) {
        let size = [batch, tensor::SCAN_CHANNELS, rings, columns];
        let scan = random_scans(size, far_m);
        let mut inputs = ort::inputs![tensor::SCAN => TensorRef::from_array_view((size, scan.as_slice()))?];
        let noise_size = [batch, card.noise_channels, rings, columns];
        let noise = random_noise(noise_size);
        if !noise.is_empty() {
            inputs.push((tensor::NOISE.into(), TensorRef::from_array_view((noise_size, noise.as_slice()))?.into()));
        }
        let outputs = session.run(inputs)?;
        let burn = |values: &[f32], size| Tensor::from_data(TensorData::new(values.to_vec(), size), &device);
        let measured = network.measure(burn(&scan, size));
        let measured = if noise.is_empty() { measured } else { measured.drawn(&burn(&noise, noise_size)) };
        for (name, burn, scale) in [
            (tensor::RANGE, measured.range_m, far_m),
            (tensor::REFLECTANCE, measured.reflectance, 1.0),
            (tensor::KEEP, measured.keep, 1.0),
        ] {
            let (shape, found) = outputs[name].try_extract_tensor::<f32>()?;
            ensure!(**shape == [batch as i64, 1, rings as i64, columns as i64], "`{name}` has shape {shape:?}");
            let expected: Vec<f32> = burn.into_data().iter::<f32>().collect();
            let off = |(a, b): (&f32, &f32)| (a - b).is_nan() || (a - b).abs() > TOLERANCE * scale;
            let differ = found.iter().zip(&expected).filter(|(a, b)| off((*a, *b))).count();
            ensure!(
                differ as f64 <= FLIPPED * found.len() as f64,
                "ONNX Runtime and Burn differ in `{name}` on {differ} of {} rays, {batch} scans of {columns} columns",
                found.len()
            );
        }
    }
    Ok(())
}

/// Uniform numbers.
fn random_noise(size: [usize; 4]) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..size.iter().product()).map(|_| rng.random()).collect()
}

/// Ranges up to the farthest, a third of them none; reflectances; classes.
fn random_scans([batch, channels, rings, columns]: [usize; 4], far_m: f32) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(columns as u64);
    let pixels = rings * columns;
    let mut scans = vec![0.0; batch * channels * pixels];
    for scan in scans.chunks_mut(channels * pixels) {
        for i in 0..pixels {
            if rng.random_bool(2.0 / 3.0) {
                scan[i] = rng.random_range(0.01..1.0) * far_m;
                scan[pixels + i] = rng.random();
                scan[2 * pixels + i] = rng.random_range(0..20) as f32;
            }
        }
    }
    scans
}
