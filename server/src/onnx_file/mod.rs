//! What an ONNX file says about itself, read from its bytes alone: metadata, inputs, outputs, and whether it is whole.
//!
//! Reading this before ONNX Runtime sees the file keeps files out that no Realbeam exporter writes, and lets a model be listed
//! and inspected without the runtime. Field numbers are those of `onnx.proto`; every other field is skipped.

mod wire;

use std::fmt;

use prost::Message;
use thiserror::Error;

/// The parts of an ONNX file that a Realbeam model is checked by.
#[derive(Clone, Debug, PartialEq)]
pub struct OnnxFile {
    /// Metadata properties, key and value.
    pub metadata: Vec<(String, String)>,
    /// The graph's inputs, weights left out.
    pub inputs: Vec<Tensor>,
    /// The graph's outputs.
    pub outputs: Vec<Tensor>,
}

/// A graph's input or output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tensor {
    /// Its name.
    pub name: String,
    /// True for float32.
    pub is_float32: bool,
    /// Its axes.
    pub shape: Vec<Axis>,
}

/// An axis of a [`Tensor`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Always of this length.
    Fixed(usize),
    /// Of a length that each run chooses, with its name.
    Dynamic(String),
}

/// A file that is no self-contained ONNX model.
#[derive(Debug, Error)]
pub enum OnnxFileError {
    /// The protobuf does not parse.
    #[error("not an ONNX file: {0}")]
    Malformed(#[from] prost::DecodeError),
    /// The model has no graph.
    #[error("not an ONNX file: field `graph` is missing")]
    NoGraph,
    /// A weight lies in another file, which nobody checks.
    #[error("weight `{0}` is external data; a Realbeam model is one file")]
    ExternalData(String),
    /// An operator that is none of ONNX's own: it may be one of the runtime's extensions, or nothing at all.
    #[error("operator `{domain}.{operator}` is none of ONNX's own")]
    ForeignOperator {
        /// Its domain.
        domain: String,
        /// Its name.
        operator: String,
    },
    /// An input or output that is no tensor, or has an impossible axis.
    #[error("tensor `{name}`: {problem}")]
    Tensor {
        /// The tensor.
        name: String,
        /// What is wrong with it.
        problem: &'static str,
    },
}

impl OnnxFile {
    /// Reads the file's bytes.
    pub fn parse(bytes: &[u8]) -> Result<Self, OnnxFileError> {
        let model = wire::Model::decode(bytes)?;
        let graph = model.graph.ok_or(OnnxFileError::NoGraph)?;
        let functions = || model.functions.iter().flat_map(|function| &function.node);
        if let Some(name) = graph.external_tensor().or_else(|| functions().find_map(wire::Node::external_tensor)) {
            return Err(OnnxFileError::ExternalData(name.into()));
        }
        if let Some(node) = graph.node.iter().chain(functions()).find_map(wire::Node::foreign) {
            let (domain, operator) = (node.domain.clone(), node.op_type.clone());
            return Err(OnnxFileError::ForeignOperator { domain, operator });
        }
        // Until IR version 3 weights were listed among the inputs too.
        let is_weight = |name: &str| graph.initializer.iter().any(|weight| weight.name == name);
        Ok(Self {
            metadata: model.metadata_props.into_iter().map(|entry| (entry.key, entry.value)).collect(),
            inputs: graph.input.iter().filter(|i| !is_weight(&i.name)).map(Tensor::read).collect::<Result<_, _>>()?,
            outputs: graph.output.iter().map(Tensor::read).collect::<Result<_, _>>()?,
        })
    }
}

impl Tensor {
    /// The axes as the Open Inference Protocol writes them: −1 is dynamic.
    pub fn dimensions(&self) -> Vec<i64> {
        let length = |axis: &Axis| match axis {
            Axis::Fixed(n) => *n as i64,
            Axis::Dynamic(_) => -1,
        };
        self.shape.iter().map(length).collect()
    }

    fn read(info: &wire::ValueInfo) -> Result<Self, OnnxFileError> {
        const FLOAT32: i32 = 1;
        let fail = |problem| OnnxFileError::Tensor { name: info.name.clone(), problem };
        let kind = info.r#type.as_ref().and_then(|t| t.tensor_type.as_ref()).ok_or_else(|| fail("is not a tensor"))?;
        let shape = kind.shape.as_ref().ok_or_else(|| fail("has no shape"))?;
        let axis = |dim: &wire::Dimension| match &dim.value {
            Some(wire::DimensionValue::Length(n)) => {
                usize::try_from(*n).map(Axis::Fixed).map_err(|_| fail("has an axis of negative length"))
            }
            Some(wire::DimensionValue::Name(name)) => Ok(Axis::Dynamic(name.clone())),
            None => Ok(Axis::Dynamic(String::new())),
        };
        Ok(Self {
            name: info.name.clone(),
            is_float32: kind.elem_type == FLOAT32,
            shape: shape.dim.iter().map(axis).collect::<Result<_, _>>()?,
        })
    }
}

impl fmt::Display for Tensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axis = |axis: &Axis| match axis {
            Axis::Fixed(n) => n.to_string(),
            Axis::Dynamic(name) if name.is_empty() => "?".into(),
            Axis::Dynamic(name) => name.clone(),
        };
        let axes: Vec<String> = self.shape.iter().map(axis).collect();
        let element = if self.is_float32 { "float32" } else { "not float32" };
        write!(f, "{} {element} [{}]", self.name, axes.join(", "))
    }
}
