//! The model at work: a session of ONNX Runtime with the memory of its inputs.

use std::mem;
use std::sync::Arc;

use lidar::RangeImage;
use lidar::ray_drop::uniform;
use ort::session::{Session, SessionOutputs};
use ort::value::TensorRef;
use proto::card::tensor;
use runtime::Threads;
use thiserror::Error;

use crate::batch::{Batches, Inputs, Values};
use crate::model::{Model, SessionError};
use crate::worker::PoolError;

/// A loaded model and its input tensors.
#[derive(Debug)]
pub(crate) struct Generator {
    runs: Runs,
    rings: usize,
    columns: usize,
    noise_channels: usize,
    /// `[3, ring, column]`
    scan: Vec<f32>,
    /// `[noise channel, ring, column]`
    noise: Vec<f32>,
}

/// Who runs the graph.
#[derive(Debug)]
enum Runs {
    /// A session of the generator's own.
    Own(Session),
    /// Sessions that it shares.
    Shared(Arc<Batches>),
}

/// What goes into the graph's `noise` input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Noise {
    /// Numbers that the seed draws: one of the scans that the sensor could measure.
    #[default]
    Drawn,
    /// ½ everywhere: range and reflectance without scatter, in the middle of what the sensor could measure.
    Median,
}

/// What a scan's answer leaves to chance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Chance {
    /// Draws ray drop, and noise where it is drawn.
    pub seed: u64,
    /// Noise in range and reflectance.
    pub noise: Noise,
}

/// The graph's outputs.
pub(crate) const OUTPUTS: [&str; 3] = [tensor::RANGE, tensor::REFLECTANCE, tensor::KEEP];

/// What a run gave, each output `[batch, 1, ring, column]`.
pub(crate) enum Outputs<'r> {
    /// In the memory of ONNX Runtime.
    Session(SessionOutputs<'r>),
    /// Taken out of a batch.
    Taken(Values),
}

/// A run that failed.
#[derive(Debug, Error)]
pub enum InferenceError {
    /// ONNX Runtime reports an error.
    #[error("ONNX Runtime: {0}")]
    Runtime(#[from] ort::Error),
    /// An output has another shape than the card promises.
    #[error("output `{name}` has shape {found:?}, expected {expected:?}")]
    Shape {
        /// The output.
        name: &'static str,
        /// Its shape.
        found: Vec<i64>,
        /// The promised one.
        expected: Vec<i64>,
    },
    /// The run ended in a panic, its own or that of those it shared it with.
    #[error("the run panicked")]
    Panicked,
    /// The sessions that it would share take no more.
    #[error("no session: {0}")]
    Refused(#[from] PoolError),
}

impl Generator {
    /// Loads a model, with `threads` within an operator.
    pub(crate) fn new(model: &Model, threads: impl Into<Threads>) -> Result<Self, SessionError> {
        Ok(Self::with(model, Runs::Own(model.session(threads)?)))
    }

    /// A generator that shares its model's sessions.
    pub(crate) fn sharing(model: &Model, batches: Arc<Batches>) -> Self {
        Self::with(model, Runs::Shared(batches))
    }

    fn with(model: &Model, runs: Runs) -> Self {
        let sensor = &model.card.sensor;
        Self {
            runs,
            rings: sensor.rings().len(),
            columns: sensor.columns(),
            noise_channels: model.card.noise_channels,
            scan: Vec::new(),
            noise: Vec::new(),
        }
    }

    /// Fills the inputs: the image into `scan`, and into `noise` ½ or numbers that depend on (seed, channel, ring, column) alone. Channel
    /// 0 of the generator decides ray drop, so noise begins with channel 1.
    pub(crate) fn fill(&mut self, image: &RangeImage, chance: Chance) {
        let pixels = self.rings * self.columns;
        self.scan.resize(tensor::SCAN_CHANNELS * pixels, 0.0);
        self.noise.resize(self.noise_channels * pixels, 0.0);
        image.write_tensor(&mut self.scan);
        match chance.noise {
            Noise::Median => self.noise.fill(0.5),
            Noise::Drawn => {
                for (channel, block) in (1..).zip(self.noise.chunks_mut(pixels)) {
                    uniform(chance.seed, channel, self.columns, block);
                }
            }
        }
    }

    /// Runs the model on what [`fill`](Self::fill) put in.
    pub(crate) fn run(&mut self) -> Result<Outputs<'_>, InferenceError> {
        let size = [1, self.rings, self.columns];
        match &mut self.runs {
            Runs::Own(session) => run(session, size, &self.scan, &self.noise),
            Runs::Shared(batches) => {
                let inputs = Inputs { size, scan: mem::take(&mut self.scan), noise: mem::take(&mut self.noise) };
                let (inputs, outputs) = batches.run(inputs)?;
                (self.scan, self.noise) = (inputs.scan, inputs.noise);
                Ok(Outputs::Taken(outputs))
            }
        }
    }

    /// Runs the model on tensors of a size `[batch, ring, column]` of its own; `noise` is empty where the model has none.
    pub(crate) fn run_on(
        &mut self,
        size: [usize; 3],
        scan: &[f32],
        noise: &[f32],
    ) -> Result<Outputs<'_>, InferenceError> {
        match &mut self.runs {
            Runs::Own(session) => run(session, size, scan, noise),
            Runs::Shared(batches) => {
                let inputs = Inputs { size, scan: scan.to_vec(), noise: noise.to_vec() };
                Ok(Outputs::Taken(batches.run(inputs)?.1))
            }
        }
    }
}

/// Runs a session; `noise` is empty where the model has none.
pub(crate) fn run<'s>(
    session: &'s mut Session,
    [batch, rings, columns]: [usize; 3],
    scan: &[f32],
    noise: &[f32],
) -> Result<Outputs<'s>, InferenceError> {
    let shape = |block: &[f32]| [batch, block.len() / (batch * rings * columns), rings, columns];
    let scan = TensorRef::from_array_view((shape(scan), scan))?;
    let outputs = if noise.is_empty() {
        session.run(ort::inputs![tensor::SCAN => scan])?
    } else {
        let noise = TensorRef::from_array_view((shape(noise), noise))?;
        session.run(ort::inputs![tensor::SCAN => scan, tensor::NOISE => noise])?
    };
    let expected = [batch as i64, 1, rings as i64, columns as i64];
    for name in OUTPUTS {
        let (shape, _) = outputs[name].try_extract_tensor::<f32>()?;
        if **shape != expected {
            return Err(InferenceError::Shape { name, found: shape.to_vec(), expected: expected.to_vec() });
        }
    }
    Ok(Outputs::Session(outputs))
}

impl Outputs<'_> {
    /// One output's values.
    pub(crate) fn of(&self, name: &'static str) -> Result<&[f32], InferenceError> {
        match self {
            Self::Session(outputs) => Ok(outputs[name].try_extract_tensor::<f32>()?.1),
            Self::Taken(values) => {
                Ok(OUTPUTS.iter().zip(values).find(|(known, _)| **known == name).map_or(&[], |(_, v)| v))
            }
        }
    }
}
