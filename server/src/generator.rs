//! The model at work: a session of ONNX Runtime with the memory of its inputs.

use lidar::RangeImage;
use lidar::ray_drop::uniform;
use ort::session::{Session, SessionOutputs};
use ort::value::TensorRef;
use proto::card::tensor;
use runtime::Threads;
use thiserror::Error;

use crate::model::{Model, SessionError};

/// A loaded model and its input tensors.
#[derive(Debug)]
pub(crate) struct Generator {
    session: Session,
    rings: usize,
    columns: usize,
    /// `[3, ring, column]`
    scan: Vec<f32>,
    /// `[noise channel, ring, column]`
    noise: Vec<f32>,
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
pub(crate) struct Outputs<'r>(SessionOutputs<'r>);

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
}

impl Generator {
    /// Loads a model, with `threads` within an operator.
    pub(crate) fn new(model: &Model, threads: impl Into<Threads>) -> Result<Self, SessionError> {
        let sensor = &model.card.sensor;
        Ok(Self {
            session: model.session(threads)?,
            rings: sensor.rings().len(),
            columns: sensor.columns(),
            scan: vec![0.0; tensor::SCAN_CHANNELS * sensor.pixels()],
            noise: vec![0.0; model.card.noise_channels * sensor.pixels()],
        })
    }

    /// Fills the inputs: the image into `scan`, and into `noise` ½ or numbers that depend on (seed, channel, ring, column) alone. Channel
    /// 0 of the generator decides ray drop, so noise begins with channel 1.
    pub(crate) fn fill(&mut self, image: &RangeImage, chance: Chance) {
        image.write_tensor(&mut self.scan);
        match chance.noise {
            Noise::Median => self.noise.fill(0.5),
            Noise::Drawn => {
                for (channel, block) in (1..).zip(self.noise.chunks_mut(self.rings * self.columns)) {
                    uniform(chance.seed, channel, self.columns, block);
                }
            }
        }
    }

    /// Runs the model on what [`fill`](Self::fill) put in.
    pub(crate) fn run(&mut self) -> Result<Outputs<'_>, InferenceError> {
        let size = [1, self.rings, self.columns];
        run(&mut self.session, size, &self.scan, &self.noise)
    }

    /// Runs the model on tensors of a size `[batch, ring, column]` of its own; `noise` is empty where the model has none.
    pub(crate) fn run_on(
        &mut self,
        size: [usize; 3],
        scan: &[f32],
        noise: &[f32],
    ) -> Result<Outputs<'_>, InferenceError> {
        run(&mut self.session, size, scan, noise)
    }
}

fn run<'s>(
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
    Ok(Outputs(outputs))
}

impl Outputs<'_> {
    /// One output's values.
    pub(crate) fn of(&self, name: &'static str) -> Result<&[f32], InferenceError> {
        Ok(self.0[name].try_extract_tensor::<f32>()?.1)
    }
}
