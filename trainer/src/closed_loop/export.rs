//! A sensor model as `model.onnx`: the generator, the effects behind it, one draw of what the sensor reports.

use std::fmt::Write as _;

use anyhow::Result;
use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData, s};
use lidar::Sensor;
use lidar::label::CLASS_NAMES;
use onnx::{Axis, Composition, Exporter};
use proto::card::{Card, Dataset, METADATA_KEY, SCHEMA, Score, tensor};

use super::base::Base;
use super::declared;
use super::model::SensorModel;
use super::network::{GENERATED, Network, OUTPUTS};
use super::outcome::Outcome;
use crate::effects::{Image, NOISE_CHANNELS, Rays, Simulated, Values};
use crate::sets::PairedSet;

/// What the licence field says where nobody said anything.
pub(super) const NO_LICENCE: &str = "not stated";

/// The numbers of a model's effects as they are in the graph: `effects.1.0` is the first parameter of the effect after the noise floor.
#[derive(Module, Debug)]
struct Numbers {
    effects: Vec<Vec<Param<Tensor<1>>>>,
}

/// The card of the model that a loop ended with.
pub fn card(set: &PairedSet, base: &Base, outcome: &Outcome, scores: Vec<Score>) -> Card {
    let before = base.file.as_ref().map(|file| &file.card);
    let learned = Dataset {
        name: format!("{}: simulated and measured scans of the same poses", set.name),
        licence: NO_LICENCE.into(),
        scans: set.frames.len(),
        sha256: set.sha256.clone(),
    };
    Card {
        schema: SCHEMA,
        name: before.map_or_else(|| servable_name(&set.name), |card| card.name.clone()),
        summary: format!("{}, calibrated on {} frames of {}", set.sensor.name, set.frames.len(), set.name),
        licence: before.map_or_else(|| NO_LICENCE.into(), |card| card.licence.clone()),
        column_multiple: set.sensor.columns(),
        noise_channels: NOISE_CHANNELS,
        // A network in front says itself which rays have a return, and that another keeps them is never wrong.
        adds_returns: adds_returns(&outcome.after, &set.sensor) || base.network.is_some(),
        drop_bursts: before.map(|card| card.drop_bursts.clone()).unwrap_or_default(),
        classes: CLASS_NAMES.iter().map(ToString::to_string).collect(),
        effects: declared::write(&outcome.after, &outcome.declared.iter().chain(&outcome.effects).collect::<Vec<_>>()),
        trained_on: before.into_iter().flat_map(|card| card.trained_on.clone()).chain([learned]).collect(),
        scores,
        notes: notes(base, outcome),
        sensor: set.sensor.clone(),
    }
}

/// The bytes of a model of the card's sensor: its network if it has one, then its effects. Number of the frame: 0.
pub fn to_onnx(model: &SensorModel, network: Option<&Network>, card: &Card) -> Result<Vec<u8>> {
    let device = Device::flex();
    let sensor = &card.sensor;
    let size = |batch: usize, channels: usize| [batch, channels, sensor.rings().len(), sensor.columns()];
    let zeros = |batch, channels| Tensor::<4>::zeros(size(batch, channels), &device);
    let exporter = Exporter::new().input(tensor::SCAN).input(tensor::NOISE);
    let batch = Axis::new("batch", 1).on(tensor::SCAN, 0).on(tensor::NOISE, 0);
    let named = |exporter: Exporter| OUTPUTS.iter().fold(exporter, |exporter, name| exporter.output(name));
    let numbers = Numbers::of(model, &device);
    let Some(network) = network else {
        let exporter = named(exporter).dynamic(batch).metadata(METADATA_KEY, &card.to_json());
        return Ok(exporter.export(
            &numbers,
            |sizes| (zeros(sizes["batch"], tensor::SCAN_CHANNELS), zeros(sizes["batch"], NOISE_CHANNELS)),
            |numbers, (scan, noise)| {
                let (range_m, reflectance) = (channel(&scan, 0), channel(&scan, 1));
                let keep = range_m.ones_like();
                numbers.draw(model, sensor, Generated { range_m, reflectance, keep, scan }, &noise)
            },
        )?);
    };
    let inputs = OUTPUTS.map(|name| format!("{GENERATED}{name}"));
    let exporter = named(inputs.iter().fold(exporter, |exporter, name| exporter.input(name)));
    let batch = inputs.iter().fold(batch, |axis, name| axis.on(name, 0));
    let effects = exporter.dynamic(batch).export(
        &numbers,
        |sizes| {
            let image = |channels| zeros(sizes["batch"], channels);
            ((image(tensor::SCAN_CHANNELS), image(NOISE_CHANNELS)), (image(1), image(1), image(1)))
        },
        |numbers, ((scan, noise), (range_m, reflectance, keep))| {
            let [range_m, reflectance, keep] = [range_m, reflectance, keep].map(|image| channel(&image, 0));
            numbers.draw(model, sensor, Generated { range_m, reflectance, keep, scan }, &noise)
        },
    )?;
    let wired = OUTPUTS.iter().zip(&inputs).fold(Composition::new(), |c, (from, to)| c.wire(from, to));
    Ok(wired.metadata(METADATA_KEY, &card.to_json()).compose(network.onnx(), &effects)?)
}

/// Whether a model reports returns on rays that have none in the simulation: where effects put some, or move rays.
pub fn adds_returns(model: &SensorModel, sensor: &Sensor) -> bool {
    let device = Device::flex();
    let nothing = || Tensor::<3>::zeros([1, sensor.rings().len(), sensor.columns()], &device);
    let simulated = Simulated {
        range_m: nothing(),
        reflectance: nothing(),
        class: nothing(),
        keep: nothing() + 1.0,
        frame: Tensor::zeros([1, 1, 1], &device),
    };
    let image = model.forward(Image::new(simulated, Rays::new(sensor, &device)));
    !image.extra.is_empty() || image.other.is_some()
}

/// A model's input as it passes the generator, images `[batch, ring, column]`.
struct Generated {
    range_m: Tensor<3>,
    reflectance: Tensor<3>,
    keep: Tensor<3>,
    /// The simulated scan, `[batch, 3, ring, column]`.
    scan: Tensor<4>,
}

impl Numbers {
    fn of(model: &SensorModel, device: &Device) -> Self {
        let parameters = |term: &super::model::Term| {
            let physical: Vec<f32> = term.physical().into_iter().map(|x| x as f32).collect();
            let tensor = |range: std::ops::Range<usize>| {
                let values = physical[range].to_vec();
                let size = [values.len()];
                Param::from_tensor(Tensor::from_data(TensorData::new(values, size), device))
            };
            term.layout().into_iter().map(|(_, range)| tensor(range)).collect()
        };
        Self { effects: model.terms.iter().map(parameters).collect() }
    }

    /// The graph: what a sensor of this model reports, `[batch, 1, ring, column]` each.
    fn draw(
        &self,
        model: &SensorModel,
        sensor: &Sensor,
        generated: Generated,
        noise: &Tensor<4>,
    ) -> (Tensor<4>, Tensor<4>, Tensor<4>) {
        let Generated { range_m, reflectance, keep, scan } = generated;
        let [batch, rings, columns] = range_m.dims();
        let none = range_m.clone().lower_equal_elem(0.0);
        let simulated = Simulated {
            class: channel(&scan, 2).mask_fill(none.clone(), 0.0),
            reflectance: reflectance.mask_fill(none, 0.0),
            range_m,
            keep,
            frame: scan.clone().slice(s![.., 0..1, 0..1, 0..1]).reshape([batch, 1, 1]) * 0.0,
        };
        let image = Image::new(simulated, Rays::new(sensor, &scan.device()));
        let act = |term: &super::model::Term, image: Image| {
            // A term is known by its name.
            let place = model.terms.iter().position(|t| t.name() == term.name()).unwrap_or_default();
            let values = self.effects[place].iter().map(Param::val).collect();
            term.effect.forward(&Values::new(values), image)
        };
        let image = model.forward_with(image, &act, None);
        let drawn = image.draw(std::array::from_fn(|i| channel(noise, i)));
        let out = |x: Tensor<3>| x.expand([batch, rings, columns]).reshape([batch, 1, rings, columns]);
        (out(drawn.range_m), out(drawn.reflectance), out(drawn.keep))
    }
}

fn channel(images: &Tensor<4>, i: usize) -> Tensor<3> {
    let [batch, _, rings, columns] = images.dims();
    images.clone().slice(s![.., i..i + 1, .., ..]).reshape([batch, rings, columns])
}

fn notes(base: &Base, outcome: &Outcome) -> String {
    let mut text = match &base.file {
        None => "Calibrated from an ideal sensor, which reports what it is shown.".to_owned(),
        Some(file) => format!("Calibrated from the model {} (SHA-256 {}).", file.card.name, file.sha256),
    };
    let names = |found: &[super::outcome::Found]| {
        let names: Vec<&str> = found.iter().map(|found| found.term.name()).collect();
        if names.is_empty() { "none".into() } else { names.join(", ") }
    };
    let _ = write!(text, " Effects that it had before and that were refitted: {}.", names(&outcome.declared));
    let _ = write!(text, " Effects that were found: {}.", names(&outcome.effects));
    text += " Scores are of scenes that nothing was fitted on, with the model as it was before in place of the pass-through.";
    for caveat in &outcome.caveats {
        let _ = write!(text, " {}.", caveat.trim_end_matches('.'));
    }
    text
}

/// A name that a server takes: one path component of plain characters.
pub(super) fn servable_name(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '-' };
    let name: String = name.trim_start_matches('.').chars().map(plain).take(64).collect();
    if name.is_empty() { "calibrated".into() } else { name }
}
