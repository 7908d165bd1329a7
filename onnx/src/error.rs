//! What can stand between a Burn module and its ONNX file.

use burn::backend::DType;
use burn::backend::capture::CaptureError;

/// Why an export failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Opset below 18 (`ReduceMean` takes its axes as an input from there) or above what the lowerings are written for.
    #[error("opset: expected 18 to 23, found {found}")]
    Opset {
        /// The opset asked for.
        found: i64,
    },
    /// As many names are needed as the forward pass has tensors.
    #[error("{boundary} names: the forward pass has {expected} {boundary} tensors, but {found} names were given")]
    NameCount {
        /// `input` or `output`.
        boundary: &'static str,
        /// Tensors of the forward pass.
        expected: usize,
        /// Names given.
        found: usize,
    },
    /// One name stands for two inputs or outputs.
    #[error("the name `{name}` is given to two inputs or outputs")]
    DuplicateName {
        /// The name.
        name: String,
    },
    /// One symbol names two dynamic axes.
    #[error("the dynamic axis `{symbol}` is declared twice: list all inputs in one declaration")]
    DuplicateAxis {
        /// The symbol.
        symbol: String,
    },
    /// A dynamic axis was declared on an input that does not exist.
    #[error("dynamic axis `{symbol}`: no input is called `{input}`")]
    UnknownInput {
        /// The axis.
        symbol: String,
        /// The missing input.
        input: String,
    },
    /// A dynamic axis has no size, no granularity or lies on no input.
    #[error(
        "dynamic axis `{symbol}`: expected a base size and a multiple of at least 1, the one a multiple of the other, and \
         an input that has the axis; found base {base}, multiple of {multiple}, {places} places"
    )]
    InvalidAxis {
        /// The axis.
        symbol: String,
        /// Declared base size.
        base: usize,
        /// Declared granularity.
        multiple: usize,
        /// Number of inputs that it lies on.
        places: usize,
    },
    /// The closure that makes inputs did not follow the sizes that it was given.
    #[error("input `{input}`, axis {axis}: expected size {expected}, found {found:?} (did the closure use its sizes?)")]
    InputSize {
        /// Graph input.
        input: String,
        /// Axis of it.
        axis: usize,
        /// The size asked for.
        expected: usize,
        /// The size found, if the tensor has such an axis.
        found: Option<usize>,
    },
    /// An input changes its shape along an axis that was not declared dynamic.
    #[error(
        "input `{input}`, axis {axis}: its size follows a dynamic axis, but is not declared dynamic (sizes {found:?})"
    )]
    UndeclaredAxis {
        /// Graph input.
        input: String,
        /// Axis of it.
        axis: usize,
        /// Its sizes in the traces.
        found: Vec<i64>,
    },
    /// An output of the forward pass does not live on the capture device.
    #[error(
        "a tensor of the forward pass does not come from the inputs or the module: create constants on `input.device()`"
    )]
    ForeignTensor,
    /// Burn refused the capture.
    #[error("capture: {0}")]
    Capture(CaptureError),
    /// The forward pass took another course at another size.
    #[error(
        "the forward pass takes another course at another size: operation {index} is {expected} at {base}, but {found} at {other}"
    )]
    Diverging {
        /// Position of the operation in the trace.
        index: usize,
        /// The operation in the base trace.
        expected: String,
        /// The operation in the other trace.
        found: String,
        /// Sizes of the base trace.
        base: String,
        /// Sizes of the other trace.
        other: String,
    },
    /// One operation cannot be written in ONNX.
    #[error("operation {index}, {operation} → {shape:?}: {refusal}")]
    Operation {
        /// Position of the operation in the trace.
        index: usize,
        /// Burn's name for the operation.
        operation: String,
        /// Shape of its first result, in the base trace.
        shape: Vec<usize>,
        /// Why it was refused.
        refusal: Refusal,
    },
    /// A constant, input or output cannot be written in ONNX.
    #[error("tensor `{name}`: {refusal}")]
    Tensor {
        /// Its name.
        name: String,
        /// Why it was refused.
        refusal: Refusal,
    },
    /// A protobuf message ends at 2 GiB.
    #[error("the file would take {found} bytes; protobuf allows 2147483647")]
    TooLarge {
        /// Encoded size, bytes.
        found: usize,
    },
}

impl From<CaptureError> for Error {
    fn from(error: CaptureError) -> Self {
        Self::Capture(error)
    }
}

/// Why one operation or tensor has no ONNX form.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// ONNX, or this exporter, has nothing like it.
    #[error("no ONNX counterpart{}", if .0.is_empty() { String::new() } else { format!(" for {}", .0) })]
    NoCounterpart(&'static str),
    /// Random numbers belong outside the graph.
    #[error("random numbers have no place in the graph: make the noise an input")]
    Random,
    /// A number or setting of the operation was computed from a dynamic size.
    #[error("it was given a number computed from a dynamic size: {base} at one size, {other} at another")]
    SizeInNumber {
        /// The operation's settings in the base trace.
        base: String,
        /// The same in another trace.
        other: String,
    },
    /// A size is no affine expression of the dynamic sizes and no size of an earlier tensor.
    #[error("the size {found:?} is not an expression of the dynamic sizes {symbols}")]
    SizeUnknown {
        /// The values it took in the traces.
        found: Vec<i64>,
        /// The dynamic sizes in the same traces.
        symbols: String,
    },
    /// A constant tensor was built from a dynamic size and is no integer ramp.
    #[error(
        "a constant built from a dynamic size (shapes {found:?} in the traces): only integer ramps such as `arange` can follow a size"
    )]
    SizeInConstant {
        /// Its shapes in the traces.
        found: Vec<Vec<usize>>,
    },
    /// The element type has no ONNX counterpart here.
    #[error("no ONNX element type for {0:?}")]
    DType(DType),
}
