//! A generator's run on tensors that somebody else has made.

use proto::card::tensor;
use proto::open_inference::Tensor;
use thiserror::Error;

use crate::generator::{Generator, InferenceError, OUTPUTS};
use crate::model::Model;
use crate::onnx_file::Axis;

/// Tensors without an answer.
#[derive(Debug, Error)]
pub(crate) enum TensorError {
    /// They are not the model's inputs.
    #[error("inputs are `{found}`, expected `{expected}`")]
    Inputs {
        /// Names and shapes that were given.
        found: String,
        /// Names and shapes that the model takes.
        expected: String,
    },
    /// The model's run failed.
    #[error("model: {0}")]
    Infer(#[from] InferenceError),
}

/// Sizes that a model takes.
struct Sizes {
    batch: usize,
    rings: usize,
    columns: usize,
    /// Columns may be another multiple of this.
    column_multiple: Option<usize>,
    noise_channels: usize,
}

/// Runs a model's generator on its inputs, in any order, in batches of at most `max_batch`. Gives all of its outputs.
pub(crate) fn run(
    model: &Model,
    generator: &mut Generator,
    inputs: &[Tensor],
    max_batch: usize,
) -> Result<Vec<Tensor>, TensorError> {
    let sizes = Sizes::of(model, max_batch);
    let (size, scan, noise) = sizes
        .check(inputs)
        .ok_or_else(|| TensorError::Inputs { found: describe(inputs), expected: sizes.describe() })?;
    let outputs = generator.run_on(size, scan, noise)?;
    let [batch, rings, columns] = size;
    let tensor = |name: &'static str| {
        let values = outputs.of(name)?.to_vec();
        Ok(Tensor { name: name.into(), shape: vec![batch, 1, rings, columns], values })
    };
    OUTPUTS.into_iter().map(tensor).collect()
}

impl Sizes {
    fn of(model: &Model, max_batch: usize) -> Self {
        let card = &model.card;
        let is_dynamic = |axis: usize| {
            let scan = model.inputs.iter().find(|input| input.name == tensor::SCAN);
            scan.is_some_and(|scan| matches!(scan.shape.get(axis), Some(Axis::Dynamic(_))))
        };
        Self {
            batch: if is_dynamic(0) { max_batch } else { 1 },
            rings: card.sensor.rings().len(),
            columns: card.sensor.columns(),
            column_multiple: is_dynamic(3).then_some(card.column_multiple),
            noise_channels: card.noise_channels,
        }
    }

    /// Batch, rings and columns of the inputs, and their values.
    fn check<'i>(&self, inputs: &'i [Tensor]) -> Option<([usize; 3], &'i [f32], &'i [f32])> {
        let find = |name: &str| inputs.iter().find(|input| input.name == name);
        let scan = find(tensor::SCAN)?;
        let [batch, channels, rings, columns] = scan.shape[..] else { return None };
        let columns_fit = match self.column_multiple {
            None => columns == self.columns,
            Some(multiple) => (1..=self.columns).contains(&columns) && columns.is_multiple_of(multiple),
        };
        let scan_fits = (1..=self.batch).contains(&batch) && (channels, rings) == (tensor::SCAN_CHANNELS, self.rings);
        let noise: &[f32] = if self.noise_channels == 0 {
            &[]
        } else {
            let noise = find(tensor::NOISE)?;
            (noise.shape == [batch, self.noise_channels, rings, columns]).then_some(&noise.values)?
        };
        let only_these = inputs.len() == 1 + usize::from(self.noise_channels > 0);
        (scan_fits && columns_fit && only_these).then_some(([batch, rings, columns], &*scan.values, noise))
    }

    fn describe(&self) -> String {
        let batch = if self.batch == 1 { "1".into() } else { format!("1 to {}", self.batch) };
        let columns = match self.column_multiple {
            None => self.columns.to_string(),
            Some(multiple) => format!("multiple of {multiple} up to {}", self.columns),
        };
        let tensor = |name: &str, channels: usize| format!("{name} [{batch}, {channels}, {}, {columns}]", self.rings);
        let scan = tensor(tensor::SCAN, tensor::SCAN_CHANNELS);
        if self.noise_channels == 0 { scan } else { format!("{scan}; {}", tensor(tensor::NOISE, self.noise_channels)) }
    }
}

fn describe(inputs: &[Tensor]) -> String {
    let inputs: Vec<_> = inputs.iter().map(|input| format!("{} {:?}", input.name, input.shape)).collect();
    inputs.join("; ")
}
