//! Several traces of one forward pass, aligned: each tensor and number of the base trace, with what became of it at the
//! other sizes.

use std::collections::HashMap;

use burn::backend::capture::TensorId;
use burn::backend::ir::{BaseOperationIr, IrVisitorMut, ModuleOperationIr, OperationIr, ScalarIr, TensorIr};
use burn::backend::{Slice, TensorData};

use crate::axis::Sizes;
use crate::error::{Error, Refusal};
use crate::trace::Trace;

/// The value that one number took in each trace, base trace first.
pub(crate) type Samples = Vec<i64>;

/// The value, if it is the same in every trace.
pub(crate) fn constant(samples: &[i64]) -> Option<i64> {
    samples.iter().all(|sample| *sample == samples[0]).then(|| samples[0])
}

/// The aligned traces; tensors go by their identity in the base trace.
pub(crate) struct Traces {
    all: Vec<Trace>,
    /// For each tensor its identity in each trace.
    twins: HashMap<TensorId, Vec<TensorId>>,
    /// For each tensor and axis its sizes.
    dims: HashMap<TensorId, Vec<Samples>>,
}

impl Traces {
    /// Aligns traces of one forward pass, taken at `sizes`; there is at least one.
    pub(crate) fn align(traces: Vec<Trace>, sizes: &[Sizes]) -> Result<Self, Error> {
        let mut aligned = Self { all: Vec::new(), twins: HashMap::new(), dims: HashMap::new() };
        let base = &traces[0];
        for (position, (other, at)) in traces.iter().zip(sizes).enumerate() {
            let diverging = |index: usize| Error::Diverging {
                index,
                expected: base.operations.get(index).map_or_else(|| "the end".into(), operation_name),
                found: other.operations.get(index).map_or_else(|| "the end".into(), operation_name),
                base: sizes[0].to_string(),
                other: at.to_string(),
            };
            let steps = base.operations.len().max(other.operations.len());
            let mut pairs: HashMap<TensorId, TensorId> = HashMap::new();
            let mut pair = |a: &TensorIr, b: &TensorIr| {
                let same_flow = *pairs.entry(a.id).or_insert(b.id) == b.id;
                if same_flow && a.shape.num_dims() == b.shape.num_dims() {
                    aligned.add(a, b, position);
                    true
                } else {
                    false
                }
            };
            if !base.inputs.iter().zip(&other.inputs).all(|(a, b)| pair(a, b)) {
                return Err(diverging(0));
            }
            for index in 0..steps {
                let (Some(a), Some(b)) = (base.operations.get(index), other.operations.get(index)) else {
                    return Err(diverging(index));
                };
                let (nodes_a, nodes_b) = (a.nodes(), b.nodes());
                let same = operation_name(a) == operation_name(b) && nodes_a.len() == nodes_b.len();
                if !same || !nodes_a.iter().zip(&nodes_b).all(|(a, b)| pair(a, b)) {
                    return Err(diverging(index));
                }
                same_settings(a, b).map_err(|refusal| operation_error(index, a, refusal))?;
            }
            if base.outputs.len() != other.outputs.len()
                || !base.outputs.iter().zip(&other.outputs).all(|(a, b)| pair(a, b))
            {
                return Err(diverging(steps));
            }
        }
        aligned.all = traces;
        Ok(aligned)
    }

    /// Notes the identity and the shape of `base` in the trace at `position`; a tensor is met many times.
    fn add(&mut self, base: &TensorIr, other: &TensorIr, position: usize) {
        let twins = self.twins.entry(base.id).or_default();
        if twins.len() > position {
            return;
        }
        twins.push(other.id);
        let dims = self.dims.entry(base.id).or_insert_with(|| vec![Samples::new(); base.shape.num_dims()]);
        for (samples, size) in dims.iter_mut().zip(other.shape.iter()) {
            samples.push(*size as i64);
        }
    }

    /// The base trace.
    pub(crate) fn base(&self) -> &Trace {
        &self.all[0]
    }

    /// The sizes of a tensor, axis by axis.
    pub(crate) fn dims(&self, tensor: TensorId) -> &[Samples] {
        self.dims.get(&tensor).map_or(&[], Vec::as_slice)
    }

    /// The values of a constant in every trace; empty if no operation reads it.
    pub(crate) fn constant(&self, tensor: TensorId) -> Vec<&TensorData> {
        let twins = self.twins.get(&tensor).map_or(&[][..], Vec::as_slice);
        self.all.iter().zip(twins).filter_map(|(trace, twin)| trace.constants.get(twin)).collect()
    }

    /// What the operation at `index` says in every trace.
    pub(crate) fn read<T>(&self, index: usize, read: impl Fn(&OperationIr) -> T) -> Vec<T> {
        self.all.iter().map(|trace| read(&trace.operations[index])).collect()
    }
}

/// The name of an operation as Burn's intermediate representation spells it, for example `NumericFloat::AddScalar`.
pub(crate) fn operation_name(operation: &OperationIr) -> String {
    let debug = format!("{operation:?}");
    let head = debug.split([' ', '{']).next().unwrap_or_default();
    let variants = debug[..debug.find('{').unwrap_or(head.len())].split(['(', ',', ' ', ')']);
    let parts: Vec<&str> = variants.filter(|part| !part.is_empty()).collect();
    // `NumericFloat(F32, AddScalar(ScalarOpIr {`: the element type and the payload's type say nothing new.
    let named = parts.iter().filter(|part| !part.ends_with("Ir") && part.chars().any(char::is_lowercase));
    named.copied().collect::<Vec<_>>().join("::")
}

/// A refusal with the operation that it concerns.
pub(crate) fn operation_error(index: usize, operation: &OperationIr, refusal: Refusal) -> Error {
    let shape = operation.outputs().next().map(|tensor| tensor.shape.iter().copied().collect()).unwrap_or_default();
    Error::Operation { index, operation: operation_name(operation), shape, refusal }
}

/// Two traces must agree on every scalar, axis, stride and mode of an operation; only tensors, slice bounds and the sizes
/// that the result's shape repeats may differ.
fn same_settings(base: &OperationIr, other: &OperationIr) -> Result<(), Refusal> {
    let (a, scalars_a) = settings(base);
    let (b, scalars_b) = settings(other);
    if scalars_a != scalars_b {
        return Err(Refusal::SizeInNumber { base: format!("{scalars_a:?}"), other: format!("{scalars_b:?}") });
    }
    if a != b {
        return Err(Refusal::SizeInNumber { base: format!("{a:?}"), other: format!("{b:?}") });
    }
    Ok(())
}

/// The operation without tensors and sizes, and its scalars.
fn settings(operation: &OperationIr) -> (OperationIr, Vec<ScalarIr>) {
    struct Blank(Vec<ScalarIr>);
    impl IrVisitorMut for Blank {
        fn visit_tensor_mut(&mut self, tensor: &mut TensorIr) {
            *tensor = TensorIr::uninit(TensorId::new(0), [0; 0].into(), tensor.dtype);
        }
        fn visit_scalar_mut(&mut self, scalar: &mut ScalarIr) {
            self.0.push(*scalar);
        }
        fn visit_range_mut(&mut self, range: &mut Slice) {
            *range = Slice::new(0, None, range.step);
        }
    }
    let mut blank = Blank(Vec::new());
    let mut operation = operation.clone();
    operation.visit_mut(&mut blank);
    match &mut operation {
        OperationIr::BaseFloat(BaseOperationIr::RepeatDim(repeat))
        | OperationIr::BaseInt(BaseOperationIr::RepeatDim(repeat))
        | OperationIr::BaseBool(BaseOperationIr::RepeatDim(repeat)) => repeat.times = 0,
        OperationIr::Module(ModuleOperationIr::Interpolate(resize)) => resize.output_size = [0, 0],
        _ => {}
    }
    (operation, blank.0)
}
