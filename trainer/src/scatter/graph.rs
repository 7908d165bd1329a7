//! Scatter inside a graph: behind a network, between its answer and what the sensor reports.

use anyhow::{Result, ensure};
use burn::module::Module;
use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, s};
use onnx::{Axis, Composition, Exporter};
use proto::card::{Card, METADATA_KEY, tensor};

use super::{LEVELS, Scatter, weight};
use crate::closed_loop::network::{GENERATED, OUTPUTS};

/// Uniform numbers for each ray.
const NOISE_CHANNELS: usize = 1;

/// Columns that the graph is traced at.
const TRACED_COLUMNS: usize = 64;

/// A graph without parameters.
#[derive(Module, Debug)]
struct Plain {}

impl Scatter {
    /// A model that has no noise yet, with this scatter behind it, and its card.
    ///
    /// # Errors
    /// If it has.
    pub fn behind(&self, onnx: &[u8], card: Card) -> Result<(Vec<u8>, Card)> {
        ensure!(
            card.noise_channels == 0,
            "its reflectances scatter already: noise_channels is {}",
            card.noise_channels
        );
        let card = Card { noise_channels: NOISE_CHANNELS, notes: format!("{} {}", card.notes, self.says()), ..card };
        let wired = OUTPUTS.iter().fold(Composition::new(), |c, name| c.wire(name, &format!("{GENERATED}{name}")));
        Ok((wired.metadata(METADATA_KEY, &card.to_json()).compose(onnx, &self.to_onnx(&card)?)?, card))
    }

    fn says(&self) -> String {
        format!(
            "Of how real reflectances scatter about what the network says ({self}), a ray's own is drawn from the noise input. Scores are of the network alone."
        )
    }

    fn to_onnx(&self, card: &Card) -> Result<Vec<u8>> {
        let (device, rings) = (Device::flex(), card.sensor.rings().len());
        let inputs: Vec<String> = OUTPUTS.iter().map(|name| format!("{GENERATED}{name}")).collect();
        let exporter = inputs.iter().fold(Exporter::new().input(tensor::NOISE), |exporter, name| exporter.input(name));
        let exporter = OUTPUTS.iter().fold(exporter, |exporter, name| exporter.output(name));
        let on_all = |axis: Axis, place: usize| {
            inputs.iter().fold(axis.on(tensor::NOISE, place), |axis, name| axis.on(name, place))
        };
        let column = Axis::new("column", TRACED_COLUMNS).multiple_of(card.column_multiple);
        Ok(exporter.dynamic(on_all(Axis::new("batch", 1), 0)).dynamic(on_all(column, 3)).export(
            &Plain {},
            |sizes| {
                let image = |channels| Tensor::<4>::zeros([sizes["batch"], channels, rings, sizes["column"]], &device);
                (image(NOISE_CHANNELS), image(1), image(1), image(1))
            },
            |_, (noise, range_m, reflectance, keep)| (range_m * 1.0, self.reported(reflectance, noise), keep * 1.0),
        )?)
    }

    /// What is reported where a network says `said`; `noise` is independent and uniform. Both `[batch, 1, ring, column]`.
    ///
    /// Linear between knots in both: Σ over ramps in the noise and ramps in `said` of their product, times a weight.
    fn reported(&self, said: Tensor<4>, noise: Tensor<4>) -> Tensor<4> {
        let device = said.device();
        let levels = LEVELS.map(|(level, _)| level as f32);
        let own: Vec<[f32; LEVELS.len()]> = self.said.iter().map(|said| self.own(*said)).collect();
        let along_noise: Vec<Vec<f32>> = own.iter().map(|quantiles| ramp_weights(&levels, quantiles)).collect();
        let along_said = |level: usize| {
            let values: Vec<f32> = along_noise.iter().map(|weights| weights[level]).collect();
            ramp_weights(&self.said, &values)
        };
        // By level and knot; the first of each goes with no ramp.
        let weights: Vec<Vec<f32>> = (0..levels.len()).map(along_said).collect();
        let flat = |from: usize| -> Vec<f32> {
            (0..self.said.len()).flat_map(|knot| weights[from..].iter().map(move |level| level[knot])).collect()
        };
        let kernel = Tensor::<1>::from_floats(&*flat(1), &device).reshape([self.said.len(), levels.len() - 1, 1, 1]);
        let bias = Tensor::<1>::from_floats(&*weights[0], &device);
        let options = ConvOptions::new([1, 1], [0, 0], [1, 1], 1);
        let mixed = conv2d(ramps(noise, &levels), kernel, Some(bias), options);
        if self.said.len() == 1 {
            return mixed;
        }
        let products = mixed.clone().slice(s![.., 1.., .., ..]) * ramps(said, &self.said);
        // ONNX Runtime's sum along an axis rounds otherwise in a batch than alone.
        let product = |k: usize| products.clone().slice(s![.., k..=k, .., ..]);
        (0..self.said.len() - 1).fold(mixed.slice(s![.., 0..1, .., ..]), |sum, k| sum + product(k))
    }

    /// Q at each of the levels of what is a ray's own.
    fn own(&self, said: f32) -> [f32; LEVELS.len()] {
        let (quantiles, own) = (self.at(said), (1.0 - self.share).sqrt());
        let scores: Vec<f32> = LEVELS.iter().map(|(_, score)| *score as f32).collect();
        LEVELS.map(|(_, score)| {
            (0..LEVELS.len()).map(|k| weight(&scores, k, (own * score) as f32) * quantiles[k]).sum::<f32>()
        })
    }
}

/// How far x is beyond each knot but the last, and at most as far as that one, `[batch, 1, ring, column]`: a channel each.
fn ramps(x: Tensor<4>, knots: &[f32]) -> Tensor<4> {
    let last = knots.len() - 1;
    let from = Tensor::<1>::from_floats(&knots[..last], &x.device()).reshape([1, last, 1, 1]);
    (x.clamp_max(knots[last]) - from).clamp_min(0.0)
}

/// Weights by which ramps, after a constant, add up to these values at the knots.
fn ramp_weights(knots: &[f32], values: &[f32]) -> Vec<f32> {
    let slope = |k: usize| (values[k + 1] - values[k]) / (knots[k + 1] - knots[k]);
    let bend = |k: usize| if k == 0 { slope(0) } else { slope(k) - slope(k - 1) };
    [values[0]].into_iter().chain((0..knots.len() - 1).map(bend)).collect()
}

#[cfg(test)]
mod tests {
    use lidar::ray_drop::uniform;
    use lidar::{RangeImage, Sensor};
    use ort::value::TensorRef;

    use super::*;
    use crate::data::holes::Pixel;
    use crate::data::sample::Sample;
    use crate::generator::{Answer, PassThrough};

    const COLUMNS: usize = 900;

    /// About ¼ by a tenth, about ¾ by a fifth, more so upwards.
    fn scatter(share: f64) -> Scatter {
        let quantiles =
            |said: f32, spread: f32| LEVELS.map(|(_, z)| said + spread * (z as f32).max(0.5 * z as f32) / 3.1);
        let measured = vec![quantiles(0.25, 0.1), quantiles(0.75, 0.2)];
        Scatter { said: vec![0.25, 0.75], measured, share, azimuth_deg: 3.0 }
    }

    fn card() -> Result<Card> {
        let sensor = Sensor::builtin("vlp16")?.with_columns(COLUMNS)?;
        let json = serde_json::json!({
            "schema": proto::card::SCHEMA, "name": "a", "summary": "A test", "licence": "MIT", "sensor": sensor,
            "column_multiple": 4, "noise_channels": 0, "classes": ["unlabelled"],
        });
        Ok(Card::from_json(&json.to_string())?)
    }

    /// What the model makes of scans that say ¼ on the upper rings and ¾ on the lower, `noise` by their number.
    fn reported(share: f64, columns: usize, scans: u64, noise: impl Fn(u64) -> Vec<f32>) -> Result<Vec<RangeImage>> {
        let (onnx, card) = scatter(share).behind(&crate::export::to_onnx(&Identity {}, &card()?)?, card()?)?;
        assert_eq!((card.noise_channels, crate::exported::card(&onnx)?), (1, card.clone()));
        let mut session = runtime::open(&runtime::environment()?, &onnx, 2)?;
        (0..scans)
            .map(|scan| {
                let image = said(columns);
                let mut input = vec![0.0; 3 * 16 * columns];
                image.write_tensor(&mut input);
                let noise = noise(scan);
                let outputs = session.run(ort::inputs![
                    tensor::SCAN => TensorRef::from_array_view(([1, 3, 16, columns], &*input))?,
                    tensor::NOISE => TensorRef::from_array_view(([1, 1, 16, columns], &*noise))?,
                ])?;
                let values =
                    |name: &str| -> Result<Vec<f32>> { Ok(outputs[name].try_extract_tensor::<f32>()?.1.to_vec()) };
                assert_eq!(values(tensor::RANGE)?, image.range_m());
                let class = image.class().to_vec();
                Ok(RangeImage::from_channels(columns, values(tensor::RANGE)?, values(tensor::REFLECTANCE)?, class))
            })
            .collect()
    }

    fn said(columns: usize) -> RangeImage {
        let reflectance = (0..16 * columns).map(|i| if i < 8 * columns { 0.25 } else { 0.75 }).collect();
        RangeImage::from_channels(columns, vec![9.0; 16 * columns], reflectance, vec![0; 16 * columns])
    }

    #[derive(Module, Debug)]
    struct Identity {}

    impl crate::generator::Generator for Identity {
        fn measure(&self, scan: Tensor<4>) -> crate::network::Measurement {
            PassThrough.measure(scan)
        }
    }

    fn drawn(scan: u64) -> Vec<f32> {
        let mut noise = vec![0.0; 16 * COLUMNS];
        uniform(scan, 2, COLUMNS, &mut noise);
        noise
    }

    fn answered(real: RangeImage) -> (Sample, Answer) {
        let pixels = 16 * COLUMNS;
        let (range_m, reflectance) = (vec![9.0; pixels], said(COLUMNS).reflectance().to_vec());
        let pixel = vec![Pixel::Kept; pixels];
        let sample = Sample { simulated: said(COLUMNS), real, pixel, keep_weight: vec![1.0; pixels] };
        (sample, Answer { range_m, reflectance, keep: vec![1.0; pixels], scatter: None })
    }

    fn measured(scans: Vec<RangeImage>) -> Result<Scatter> {
        let scans: Vec<_> = scans.into_iter().map(answered).collect();
        Scatter::measure(&scans, 360.0 / COLUMNS as f64)
    }

    #[test]
    fn what_the_graph_draws_is_measured_as_it_was_drawn() -> Result<()> {
        let (found, expected) = (measured(reported(0.0, COLUMNS, 40, drawn)?)?, scatter(0.0));
        assert_eq!(found.said, expected.said);
        for (found, expected) in found.measured.iter().flatten().zip(expected.measured.iter().flatten()) {
            assert!((found - expected).abs() < 0.012, "{found}, expected {expected}");
        }
        assert!(found.share < 0.01, "{found}");
        Ok(())
    }

    #[test]
    fn what_neighbours_share_is_measured_and_not_drawn() -> Result<()> {
        // Half of each ray's number is its own, half it shares with those before it along its ring.
        let rate = (-0.4_f64 / 3.0).exp();
        let scans = (0..40).map(|scan| {
            let normal = |channel| -> Vec<f32> {
                let mut numbers = vec![0.0; 16 * COLUMNS];
                uniform(scan, channel, COLUMNS, &mut numbers);
                let numbers = Tensor::<1>::from_floats(&*numbers, &Device::flex()).reshape([1, 16, COLUMNS]);
                crate::effects::normal(numbers).into_data().iter::<f32>().collect()
            };
            let (own, fresh) = (normal(2), normal(3));
            let mut image = said(COLUMNS);
            let mut shared = 0.0;
            for i in 0..16 * COLUMNS {
                let fresh = f64::from(fresh[i]);
                let first = i % COLUMNS == 0;
                shared = if first { fresh } else { rate * shared + (1.0 - rate * rate).sqrt() * fresh };
                let z = 0.5_f64.sqrt() * (f64::from(own[i]) + shared);
                let said = image.reflectance()[i];
                image.set(i, 9.0, said + 0.05 * z as f32, 0);
            }
            image
        });
        let found = measured(scans.collect())?;
        assert!((found.share - 0.5).abs() < 0.04 && (found.azimuth_deg - 3.0).abs() < 0.4, "{found}");
        let deviation = |scans: Vec<RangeImage>| {
            let squares =
                scans.iter().flat_map(|scan| scan.reflectance()[..COLUMNS].iter().map(|r| (r - 0.25).powi(2)));
            (squares.sum::<f32>() / (scans.len() * COLUMNS) as f32).sqrt()
        };
        let ratio = deviation(reported(0.6, COLUMNS, 10, drawn)?) / deviation(reported(0.0, COLUMNS, 10, drawn)?);
        assert!((ratio - 0.4_f32.sqrt()).abs() < 0.03, "{ratio}");
        Ok(())
    }

    #[test]
    fn half_of_the_noise_everywhere_is_the_median_at_any_number_of_columns() -> Result<()> {
        for columns in [4, 60, COLUMNS] {
            let scan = reported(0.6, columns, 1, |_| vec![0.5; 16 * columns])?.remove(0);
            for (found, said) in scan.reflectance().iter().zip(said(columns).reflectance()) {
                assert!((found - said).abs() < 1e-5, "{columns}: {found}, expected {said}");
            }
        }
        Ok(())
    }

    #[test]
    fn a_model_that_draws_already_is_refused() -> Result<()> {
        let card = Card { noise_channels: 1, ..card()? };
        assert!(scatter(0.6).behind(&[], card).is_err_and(|e| e.to_string().contains("noise_channels is 1")));
        Ok(())
    }

    #[test]
    fn a_graph_goes_through_every_quantile_and_straight_between() {
        let (scatter, device) = (Scatter { said: vec![0.1, 0.15, 0.9], ..scatter(0.0) }, Device::flex());
        let measured =
            [0.1, 0.3, 0.2].map(|middle| LEVELS.map(|(level, _)| middle + 0.1 * level.powi(2) as f32)).to_vec();
        let scatter = Scatter { measured, ..scatter };
        let at = |said: f32, level: f32| -> f32 {
            let image = |x: f32| Tensor::<4>::full([1, 1, 1, 1], x, &device);
            scatter.reported(image(said), image(level)).into_scalar()
        };
        for (said, quantiles) in scatter.said.iter().zip(&scatter.measured) {
            for ((level, _), expected) in LEVELS.iter().zip(quantiles) {
                let found = at(*said, *level as f32);
                assert!((found - expected).abs() < 1e-5, "{said} {level}: {found}, expected {expected}");
            }
        }
        let half = f32::midpoint(scatter.measured[0][5], scatter.measured[1][5]);
        assert!((at(0.125, 0.5) - half).abs() < 1e-5);
        assert_eq!([at(0.0, 0.5), at(1.0, 0.5)], [at(0.1, 0.5), at(0.9, 0.5)]);
        assert_eq!([at(0.1, 0.0), at(0.1, 1.0)], [at(0.1, 0.001), at(0.1, 0.999)]);
    }
}
