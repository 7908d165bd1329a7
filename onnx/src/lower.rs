//! Lowering: each recorded operation becomes ONNX nodes.

mod activation;
mod base;
mod dim;
mod float;
mod module;
mod numeric;
mod pool;
mod slice;

use std::collections::{BTreeMap, HashMap, HashSet};

use burn::backend::capture::TensorId;
use burn::backend::ir::{
    BoolOperationIr as Bool, CastOpIr, IntOperationIr as Int, OperationIr, ScalarIr, ScalarOpIr, TensorIr,
};
use burn::backend::{DType, TensorData};

use crate::data::{self, element_type, scalar_bytes};
use crate::error::{Error, Refusal};
use crate::graph::Graph;
use crate::norm::{Norm, Norms};
use crate::proto::AttributeProto;
use crate::traces::{Samples, Traces, operation_error};
use dim::Dim;

/// A dynamic axis: its symbol, the first input that it lies on, and its sizes.
pub(crate) struct Symbol {
    pub(crate) name: String,
    pub(crate) input: String,
    pub(crate) axis: usize,
    pub(crate) samples: Samples,
}

/// Aligned traces on their way into a graph.
pub(crate) struct Lowering<'a> {
    pub(crate) graph: Graph,
    traces: &'a Traces,
    symbols: &'a [Symbol],
    norms: Norms,
    names: HashMap<TensorId, String>,
    /// How many operations read a tensor.
    readers: HashMap<TensorId, usize>,
    /// Sizes at run time that the graph computes already.
    sizes: BTreeMap<Dim, String>,
    /// Position of the operation being lowered.
    index: usize,
}

impl<'a> Lowering<'a> {
    /// Starts a graph with the given names for inputs and outputs.
    pub(crate) fn new(traces: &'a Traces, symbols: &'a [Symbol], inputs: &[String], outputs: &[String]) -> Self {
        let mut readers = HashMap::new();
        for tensor in traces.base().operations.iter().flat_map(OperationIr::inputs) {
            *readers.entry(tensor.id).or_insert(0) += 1;
        }
        let mut lowering = Self {
            graph: Graph::default(),
            traces,
            symbols,
            norms: Norms::find(&traces.base().operations),
            names: HashMap::new(),
            readers,
            sizes: BTreeMap::new(),
            index: 0,
        };
        for name in inputs.iter().chain(outputs) {
            lowering.graph.claim(name);
        }
        for (tensor, name) in traces.base().inputs.iter().zip(inputs) {
            lowering.names.insert(tensor.id, name.clone());
        }
        lowering
    }

    /// Writes constants, operations and outputs.
    pub(crate) fn run(&mut self, outputs: &[String]) -> Result<(), Error> {
        let base = self.traces.base();
        for id in base.constants.keys() {
            self.constant(*id)?;
        }
        // An output that an operation defines takes its name; one that is an input, a constant or another output cannot.
        let defined: HashSet<TensorId> =
            base.operations.iter().flat_map(OperationIr::outputs).map(|out| out.id).collect();
        for (tensor, name) in base.outputs.iter().zip(outputs) {
            if defined.contains(&tensor.id) {
                self.names.entry(tensor.id).or_insert_with(|| name.clone());
            }
        }
        for (index, operation) in base.operations.iter().enumerate() {
            self.index = index;
            self.operation(operation).map_err(|refusal| operation_error(index, operation, refusal))?;
        }
        for (tensor, name) in base.outputs.iter().zip(outputs) {
            let source = self.name(tensor);
            if source != *name {
                self.graph.node("Identity", vec![source], name, Vec::new());
            }
        }
        Ok(())
    }

    /// A constant must be the same in every trace, or an integer ramp whose length follows a size, which becomes `Range`.
    fn constant(&mut self, id: TensorId) -> Result<(), Error> {
        let base = self.traces.base();
        let samples = self.traces.constant(id);
        let Some(first) = samples.first() else { return Ok(()) };
        let name = self.graph.claim(base.parameters.get(&id).map_or("constant", String::as_str));
        self.names.insert(id, name.clone());
        let refused = |refusal| Error::Tensor { name: name.clone(), refusal };
        if samples.iter().all(|data| data.shape() == first.shape() && data.bytes() == first.bytes()) {
            self.graph.initializer(data::tensor(name.clone(), first).map_err(refused)?);
            return Ok(());
        }
        self.ramp(&name, &samples).map_err(refused)
    }

    fn ramp(&mut self, name: &str, samples: &[&TensorData]) -> Result<(), Refusal> {
        let refusal = || Refusal::SizeInConstant {
            found: samples.iter().map(|data| data.shape().iter().copied().collect()).collect(),
        };
        let (start, step) = common_ramp(samples).ok_or_else(refusal)?;
        let limits: Samples = samples.iter().map(|data| start + step * data.num_elements() as i64).collect();
        let limit = self.dim(&limits)?;
        let limit = self.size(&limit);
        let limit = self.graph.value("Squeeze", vec![limit], Vec::new());
        let (start, step) = (self.graph.integer(start), self.graph.integer(step));
        let range = self.graph.value("Range", vec![start, limit, step], Vec::new());
        let to = element_type(samples[0].dtype())? as i64;
        self.graph.node("Cast", vec![range], name, vec![AttributeProto::int("to", to)]);
        Ok(())
    }

    fn operation(&mut self, operation: &OperationIr) -> Result<(), Refusal> {
        if let Some(norm) = self.norms.at.get(&self.index).cloned()
            && let Some(out) = operation.outputs().next()
        {
            self.norm(&norm, out);
            return Ok(());
        }
        match operation {
            OperationIr::Drop(_) => {}
            OperationIr::BaseFloat(base) | OperationIr::BaseInt(base) | OperationIr::BaseBool(base) => {
                self.base(base)?;
            }
            OperationIr::NumericFloat(_, numeric) | OperationIr::NumericInt(_, numeric) => self.numeric(numeric)?,
            OperationIr::Float(_, float) => self.float(float)?,
            OperationIr::Int(Int::IntoFloat(cast)) | OperationIr::Bool(Bool::IntoFloat(cast) | Bool::IntoInt(cast)) => {
                self.cast(cast)?;
            }
            OperationIr::Int(Int::Matmul(matmul)) => {
                self.emit("MatMul", &[&matmul.lhs, &matmul.rhs], &matmul.out, vec![]);
            }
            OperationIr::Bool(Bool::Not(unary)) => self.emit("Not", &[&unary.input], &unary.out, vec![]),
            OperationIr::Bool(Bool::And(pair)) => self.emit("And", &[&pair.lhs, &pair.rhs], &pair.out, vec![]),
            OperationIr::Bool(Bool::Or(pair)) => self.emit("Or", &[&pair.lhs, &pair.rhs], &pair.out, vec![]),
            OperationIr::Bool(Bool::Xor(pair)) => self.emit("Xor", &[&pair.lhs, &pair.rhs], &pair.out, vec![]),
            OperationIr::Activation(activation) => self.activation(activation)?,
            OperationIr::Module(module) => self.module(module)?,
            _ => return Err(Refusal::NoCounterpart("")),
        }
        Ok(())
    }

    fn norm(&mut self, norm: &Norm, out: &TensorIr) {
        let groups = norm.input.shape[1];
        let (scale, offset) = match &norm.affine {
            Some((scale, offset)) => (self.name(scale), self.name(offset)),
            None => (self.graph.floats(&vec![1.0; groups]), self.graph.floats(&vec![0.0; groups])),
        };
        let inputs = vec![self.name(&norm.input), scale, offset];
        self.emit_named("InstanceNormalization", inputs, out, vec![AttributeProto::float("epsilon", norm.epsilon)]);
    }

    fn cast(&mut self, cast: &CastOpIr) -> Result<(), Refusal> {
        let to = element_type(cast.out.dtype)? as i64;
        self.emit("Cast", &[&cast.input], &cast.out, vec![AttributeProto::int("to", to)]);
        Ok(())
    }

    /// The ONNX name of a tensor.
    fn name(&mut self, tensor: &TensorIr) -> String {
        let graph = &mut self.graph;
        self.names.entry(tensor.id).or_insert_with(|| graph.claim("value")).clone()
    }

    /// A node over whole tensors.
    fn emit(&mut self, op: &str, inputs: &[&TensorIr], out: &TensorIr, attributes: Vec<AttributeProto>) {
        let inputs = inputs.iter().map(|tensor| self.name(tensor)).collect();
        self.emit_named(op, inputs, out, attributes);
    }

    /// A node over named values.
    fn emit_named(&mut self, op: &str, inputs: Vec<String>, out: &TensorIr, attributes: Vec<AttributeProto>) {
        let out = self.name(out);
        self.graph.node(op, inputs, &out, attributes);
    }

    /// A node over a tensor and a scalar of its type.
    fn emit_scalar(&mut self, op: &str, operation: &ScalarOpIr) -> Result<(), Refusal> {
        let inputs = vec![self.name(&operation.lhs), self.scalar(operation.lhs.dtype, operation.rhs)?];
        self.emit_named(op, inputs, &operation.out, Vec::new());
        Ok(())
    }

    fn scalar(&mut self, dtype: DType, scalar: ScalarIr) -> Result<String, Refusal> {
        Ok(self.graph.scalar(element_type(dtype)?, scalar_bytes(dtype, scalar)?))
    }
}

/// Start and step, if every sample is a ramp of integers with the same two.
fn common_ramp(samples: &[&TensorData]) -> Option<(i64, i64)> {
    let mut common = None;
    for data in samples {
        let is_vector = data.shape().num_dims() == 1 && data.dtype().is_int();
        let values: Vec<i64> = if is_vector { data.iter::<i64>().collect() } else { Vec::new() };
        let (first, second) = (*values.first()?, *values.get(1)?);
        let ramp = (first, second - first);
        let fits = ramp.1 != 0 && values.windows(2).all(|pair| pair[1] - pair[0] == ramp.1);
        if !fits || *common.get_or_insert(ramp) != ramp {
            return None;
        }
    }
    common
}
