//! A model: one checked ONNX file with its card and digest.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use ort::session::Session;
use proto::card::{self, Card, tensor};
use runtime::{RuntimeError, Threads};
use sha2::{Digest, Sha256};
use thiserror::Error;

use crate::check::CheckError;
use crate::onnx_file::{Axis, OnnxFile, OnnxFileError, Tensor};

/// Bytes that a model's file may have, unless somebody says otherwise.
pub const MAX_MODEL_BYTES: u64 = 1 << 30;

/// A model whose file is whole, has a card, and whose graph's inputs and outputs are what the card promises.
#[derive(Clone, Debug)]
pub struct Model {
    /// Name under which it is served: its directory's, or the card's where the file was named directly.
    pub name: String,
    /// Version under which it is served; `None` for a file that lies in no repository.
    pub version: Option<u64>,
    /// SHA-256 of the file, in hexadecimal.
    pub digest: String,
    /// What the model says about itself.
    pub card: Card,
    /// The graph's inputs: `scan` and, where the card asks for noise, `noise`.
    pub inputs: Vec<Tensor>,
    /// The graph's outputs: `range`, `reflectance`, `keep`.
    pub outputs: Vec<Tensor>,
    bytes: Vec<u8>,
}

/// A file that is no model of ours.
#[derive(Debug, Error)]
#[error("model {}: {problem}", path.display())]
pub struct ModelError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: ModelProblem,
}

/// What can be wrong with a model's file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ModelProblem {
    /// It cannot be read.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// It is larger than a model may be; nothing beyond that has been read.
    #[error("has {found} bytes, expected at most {max} (max_model_bytes)")]
    TooLarge {
        /// Bytes that it has, or has at least where it grew while it was read.
        found: u64,
        /// Bytes that it may have.
        max: u64,
    },
    /// It is no self-contained ONNX file.
    #[error(transparent)]
    File(#[from] OnnxFileError),
    /// It has no card.
    #[error("has no card: metadata property `{}` is missing; export it with realbeam-trainer", card::METADATA_KEY)]
    NoCard,
    /// Its card cannot be taken.
    #[error(transparent)]
    Card(#[from] card::CardError),
    /// It did not pass its check.
    #[error(transparent)]
    Check(#[from] CheckError),
    /// The graph does not keep what the card promises.
    #[error("graph and card disagree: {what} are `{found}`, expected `{expected}`")]
    Signature {
        /// Inputs or outputs.
        what: &'static str,
        /// What the graph has.
        found: String,
        /// What the card promises.
        expected: String,
    },
}

/// A checked model that ONNX Runtime does not take.
#[derive(Debug, Error)]
pub enum SessionError {
    /// The runtime itself is missing or broken.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// The runtime refuses the graph.
    #[error("model `{name}`: ONNX Runtime does not load it: {source}")]
    Load {
        /// The model.
        name: String,
        /// The runtime's words.
        source: ort::Error,
    },
}

impl Model {
    /// Reads and checks a file of at most `max_bytes` that lies in no repository; its name is the card's.
    pub fn read(path: &Path, max_bytes: u64) -> Result<Self, ModelError> {
        let model = read_file(path, max_bytes).and_then(Self::from_bytes);
        model.map_err(|problem| ModelError { path: path.into(), problem })
    }

    /// Checks the bytes of a model's file.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self, ModelProblem> {
        let file = OnnxFile::parse(&bytes)?;
        let json = file.metadata.iter().find(|(key, _)| key == card::METADATA_KEY).ok_or(ModelProblem::NoCard)?;
        let card = Card::from_json(&json.1)?;
        check_signature("inputs", &file.inputs, &card, &expected_inputs(&card))?;
        check_signature("outputs", &file.outputs, &card, &OUTPUTS)?;
        let digest = digest(&bytes);
        Ok(Self {
            name: card.name.clone(),
            version: None,
            digest,
            card,
            inputs: file.inputs,
            outputs: file.outputs,
            bytes,
        })
    }

    /// True if one run takes several scans.
    pub(crate) fn takes_batches(&self) -> bool {
        self.inputs.iter().all(|input| matches!(input.shape.first(), Some(Axis::Dynamic(_))))
    }

    /// Loads the model into ONNX Runtime, with `threads` within an operator.
    pub fn session(&self, threads: impl Into<Threads>) -> Result<Session, SessionError> {
        let environment = runtime::environment()?;
        runtime::open(&environment, &self.bytes, threads)
            .map_err(|source| SessionError::Load { name: self.name.clone(), source })
    }
}

/// A file's bytes, if it has at most `max`.
pub(crate) fn read_file(path: &Path, max: u64) -> Result<Vec<u8>, ModelProblem> {
    let file = File::open(path)?;
    let found = file.metadata()?.len();
    if found > max {
        return Err(ModelProblem::TooLarge { found, max });
    }
    let mut bytes = Vec::with_capacity(found as usize);
    // It may grow while it is read.
    file.take(max.saturating_add(1)).read_to_end(&mut bytes)?;
    let found = bytes.len() as u64;
    if found > max { Err(ModelProblem::TooLarge { found, max }) } else { Ok(bytes) }
}

/// SHA-256 of a file's bytes, in hexadecimal.
pub(crate) fn digest(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

/// Lower-case hexadecimal digits.
pub(crate) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a string cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// Name and number of channels of each output.
const OUTPUTS: [(&str, usize); 3] = [(tensor::RANGE, 1), (tensor::REFLECTANCE, 1), (tensor::KEEP, 1)];

fn expected_inputs(card: &Card) -> Vec<(&'static str, usize)> {
    let noise = (card.noise_channels > 0).then_some((tensor::NOISE, card.noise_channels));
    [(tensor::SCAN, tensor::SCAN_CHANNELS)].into_iter().chain(noise).collect()
}

/// Every expected tensor is there as float32 `[batch, channels, ring, column]`, in any order, and no other. The batch axis is dynamic
/// or 1, the ring axis the card's rings or dynamic, the column axis the card's columns or dynamic.
fn check_signature(
    what: &'static str,
    found: &[Tensor],
    card: &Card,
    expected: &[(&'static str, usize)],
) -> Result<(), ModelProblem> {
    let (rings, columns) = (card.sensor.rings().len(), card.sensor.columns());
    let takes = |axis: &Axis, length: usize| matches!(axis, Axis::Dynamic(_)) || *axis == Axis::Fixed(length);
    let fits = |tensor: &Tensor, channels: usize| {
        let lengths = [1, channels, rings, columns];
        let axes_fit = tensor.shape.len() == 4 && tensor.shape.iter().zip(lengths).all(|(axis, n)| takes(axis, n));
        tensor.is_float32 && axes_fit
    };
    let there = |(name, channels): &(&str, usize)| found.iter().any(|t| t.name == *name && fits(t, *channels));
    if found.len() == expected.len() && expected.iter().all(there) {
        return Ok(());
    }
    let found: Vec<String> = found.iter().map(Tensor::to_string).collect();
    let expected =
        expected.iter().map(|(name, k)| format!("{name} float32 [batch, {k}, {rings}, column or {columns}]"));
    let expected = expected.collect::<Vec<_>>().join("; ");
    Err(ModelProblem::Signature { what, found: found.join("; "), expected })
}
