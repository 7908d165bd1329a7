//! The export itself: what to call things, what stays free, and the way from a module to bytes.

use std::collections::HashSet;

use burn::backend::ir::TensorIr;
use burn::module::Module;

use crate::axis::{Axis, Sizes};
use crate::boundary::Boundary;
use crate::data::element_type;
use crate::error::Error;
use crate::lower::{Lowering, Symbol};
use crate::proto::{Dimension, DimensionValue, TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto};
use crate::trace::Trace;
use crate::traces::{Samples, Traces, constant};

/// Exports a module; see the [crate] for an example.
#[derive(Clone, Debug)]
pub struct Exporter {
    inputs: Vec<String>,
    outputs: Vec<String>,
    axes: Vec<Axis>,
    metadata: Vec<(String, String)>,
    opset: i64,
}

impl Default for Exporter {
    fn default() -> Self {
        Self { inputs: Vec::new(), outputs: Vec::new(), axes: Vec::new(), metadata: Vec::new(), opset: 18 }
    }
}

impl Exporter {
    /// An export with opset 18 and no dynamic axes.
    pub fn new() -> Self {
        Self::default()
    }

    /// Names the next input of the forward pass.
    #[must_use]
    pub fn input(mut self, name: &str) -> Self {
        self.inputs.push(name.into());
        self
    }

    /// Names the next output of the forward pass.
    #[must_use]
    pub fn output(mut self, name: &str) -> Self {
        self.outputs.push(name.into());
        self
    }

    /// Leaves an axis free.
    #[must_use]
    pub fn dynamic(mut self, axis: Axis) -> Self {
        self.axes.push(axis);
        self
    }

    /// Adds a metadata property.
    #[must_use]
    pub fn metadata(mut self, key: &str, value: &str) -> Self {
        self.metadata.push((key.into(), value.into()));
        self
    }

    /// Chooses the opset, 18 to 23.
    #[must_use]
    pub fn opset(mut self, version: i64) -> Self {
        self.opset = version;
        self
    }

    /// Traces `forward` over `module` and returns the bytes of an ONNX file; the same module gives the same bytes.
    ///
    /// `inputs` makes input tensors of the sizes that it is given; only their shapes and element types count. The forward
    /// pass runs for its operations alone, `k + 3` times for `k` dynamic axes, and computes nothing.
    ///
    /// # Errors
    /// Names or axes that do not fit the forward pass, and operations that ONNX cannot say: see [`Error`].
    ///
    /// # Panics
    /// If `forward` reads a value back, as `into_scalar` does: under capture there is none.
    pub fn export<M: Module, I: Boundary, O: Boundary>(
        &self,
        module: &M,
        inputs: impl Fn(&Sizes) -> I,
        forward: impl Fn(&M, I) -> O,
    ) -> Result<Vec<u8>, Error> {
        self.check()?;
        let plan = Sizes::plan(&self.axes);
        let traces = plan.iter().map(|sizes| {
            let trace = Trace::record(module, inputs(sizes), &forward)?;
            self.check_boundary(&trace, sizes)?;
            Ok(trace)
        });
        let traces = Traces::align(traces.collect::<Result<_, Error>>()?, &plan)?;
        let symbols = self.symbols(&plan);
        let inputs = describe(&traces, &symbols, &self.inputs, &traces.base().inputs)?;
        self.check_declared(&inputs, &traces)?;
        let outputs = describe(&traces, &symbols, &self.outputs, &traces.base().outputs)?;
        let mut lowering = Lowering::new(&traces, &symbols, &self.inputs, &self.outputs);
        lowering.run(&self.outputs)?;
        let mut graph = lowering.graph;
        graph.declare(inputs, outputs);
        graph.encode(self.opset, &self.metadata)
    }

    /// Checks what was declared, before anything is traced.
    fn check(&self) -> Result<(), Error> {
        if !(18..=23).contains(&self.opset) {
            return Err(Error::Opset { found: self.opset });
        }
        let mut names = HashSet::new();
        if let Some(name) = self.inputs.iter().chain(&self.outputs).find(|name| !names.insert(*name)) {
            return Err(Error::DuplicateName { name: name.clone() });
        }
        let mut symbols = HashSet::new();
        if let Some(axis) = self.axes.iter().find(|axis| !symbols.insert(&axis.symbol)) {
            return Err(Error::DuplicateAxis { symbol: axis.symbol.clone() });
        }
        self.axes.iter().try_for_each(|axis| axis.check(&self.inputs))
    }

    /// Checks the names and the dynamic axes against a trace.
    fn check_boundary(&self, trace: &Trace, sizes: &Sizes) -> Result<(), Error> {
        for (boundary, tensors, names) in
            [("input", &trace.inputs, &self.inputs), ("output", &trace.outputs, &self.outputs)]
        {
            if tensors.len() != names.len() {
                return Err(Error::NameCount { boundary, expected: tensors.len(), found: names.len() });
            }
        }
        for axis in &self.axes {
            let expected = sizes[&axis.symbol];
            for (input, place) in &axis.places {
                let tensor = trace.inputs.iter().zip(&self.inputs).find(|(_, name)| *name == input);
                let found = tensor.and_then(|(tensor, _)| tensor.shape.iter().nth(*place).copied());
                if found != Some(expected) {
                    return Err(Error::InputSize { input: input.clone(), axis: *place, expected, found });
                }
            }
        }
        Ok(())
    }

    /// Every input axis that moved in the traces must be declared, on this very input.
    fn check_declared(&self, inputs: &[ValueInfoProto], traces: &Traces) -> Result<(), Error> {
        for (tensor, info) in traces.base().inputs.iter().zip(inputs) {
            for (axis, samples) in traces.dims(tensor.id).iter().enumerate() {
                let declared = self.axes.iter().any(|declared| declared.places.contains(&(info.name.clone(), axis)));
                if constant(samples).is_none() && !declared {
                    return Err(Error::UndeclaredAxis { input: info.name.clone(), axis, found: samples.clone() });
                }
            }
        }
        Ok(())
    }

    fn symbols(&self, plan: &[Sizes]) -> Vec<Symbol> {
        let symbol = |axis: &Axis| {
            let (input, position) = axis.places.first()?;
            let samples: Samples = plan.iter().map(|sizes| sizes[&axis.symbol] as i64).collect();
            Some(Symbol { name: axis.symbol.clone(), input: input.clone(), axis: *position, samples })
        };
        self.axes.iter().filter_map(symbol).collect()
    }
}

/// Names and types of the graph's inputs or outputs: a size is a number, a symbol, or, on an output, a name of its own.
fn describe(
    traces: &Traces,
    symbols: &[Symbol],
    names: &[String],
    tensors: &[TensorIr],
) -> Result<Vec<ValueInfoProto>, Error> {
    let describe = |(tensor, name): (&TensorIr, &String)| {
        let size = |(axis, samples): (usize, &Samples)| {
            let symbol = symbols.iter().find(|symbol| symbol.samples == *samples);
            let value = match (constant(samples), symbol) {
                (Some(size), _) => DimensionValue::Size(size),
                (None, Some(symbol)) => DimensionValue::Symbol(symbol.name.clone()),
                (None, None) => DimensionValue::Symbol(format!("{name}_dim{axis}")),
            };
            Dimension { value: Some(value) }
        };
        let dim = traces.dims(tensor.id).iter().enumerate().map(size).collect();
        let elem_type = element_type(tensor.dtype).map_err(|refusal| Error::Tensor { name: name.clone(), refusal })?;
        let tensor_type = Some(TensorTypeProto { elem_type, shape: Some(TensorShapeProto { dim }) });
        Ok(ValueInfoProto { name: name.clone(), r#type: Some(TypeProto { tensor_type }) })
    };
    tensors.iter().zip(names).map(describe).collect()
}
