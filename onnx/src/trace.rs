//! One traced forward pass: the operations that Burn's capture device recorded, and the tensors that they start from.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use burn::backend::TensorData;
use burn::backend::capture::{CaptureBackend, TensorId};
use burn::backend::ir::{OperationIr, TensorIr};
use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Bool, Device, Int, Tensor};

use crate::boundary::Boundary;
use crate::error::Error;
use crate::linear;

/// A recorded forward pass.
pub(crate) struct Trace {
    pub(crate) operations: Vec<OperationIr>,
    pub(crate) inputs: Vec<TensorIr>,
    pub(crate) outputs: Vec<TensorIr>,
    /// Parameters and other constants; the inputs' values are left out.
    pub(crate) constants: BTreeMap<TensorId, TensorData>,
    /// Paths of the parameters within the module, such as `stem.conv.weight`.
    pub(crate) parameters: HashMap<TensorId, String>,
}

impl Trace {
    /// Records `forward`; nothing is computed.
    ///
    /// The module is traced as a validation copy: moving a plain clone to the capture device would take the running
    /// statistics of its normalisations along, because clones share them.
    pub(crate) fn record<M: Module, I: Boundary, O: Boundary>(
        module: &M,
        input: I,
        forward: impl FnOnce(&M, I) -> O,
    ) -> Result<Self, Error> {
        let device = Device::capture();
        let module = module.valid();
        let mut boundary = Err(Error::ForeignTensor);
        let mut parameters = HashMap::new();
        let captured = device.capture_scope(|scope| {
            let module = module.to_device(&device).map(&mut Integers(&device));
            let mut names = ParameterNames::default();
            module.visit(&mut names);
            parameters = names.of;
            let input = input.to_capture(&device);
            let inputs = input.captured();
            let outputs = forward(&module, input).captured();
            match (inputs, outputs) {
                (Ok(inputs), Ok(outputs)) => {
                    // One tensor may be returned twice; the scope accepts it once.
                    let unique: BTreeSet<TensorId> = outputs.iter().map(|tensor| tensor.id).collect();
                    let completed = scope.complete(inputs.iter().map(|tensor| tensor.id), unique);
                    boundary = Ok((inputs, outputs));
                    completed
                }
                (Err(error), _) | (_, Err(error)) => {
                    boundary = Err(error);
                    scope.complete([], [])
                }
            }
        });
        let (inputs, outputs) = boundary?;
        let captured = captured?;
        let mut constants = captured.values;
        constants.retain(|id, _| inputs.iter().all(|tensor| tensor.id != *id));
        let mut operations = captured.graph.operations;
        operations.retain(|operation| !matches!(operation, OperationIr::Init(_)));
        let operations = linear::recognise(&operations, &outputs);
        Ok(Self { operations, inputs, outputs, constants, parameters })
    }
}

/// Gives integer parameters the capture device's integer type, as [`Boundary`] does for inputs.
struct Integers<'a>(&'a Device);

impl ModuleMapper for Integers<'_> {
    fn map_int<const D: usize>(&mut self, param: Param<Tensor<D, Int>>) -> Param<Tensor<D, Int>> {
        param.map(|tensor| Tensor::from_data(tensor.into_data(), self.0))
    }
}

/// Collects the path of each parameter by the tensor that carries it.
#[derive(Default)]
struct ParameterNames {
    path: Vec<String>,
    of: HashMap<TensorId, String>,
}

impl ModuleVisitor for ParameterNames {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Ok(tensor) = param.base().try_into_primitive::<CaptureBackend>() {
            self.of.insert(tensor.id(), self.path.join("."));
        }
    }

    fn visit_int<const D: usize>(&mut self, param: &Param<Tensor<D, Int>>) {
        if let Ok(tensor) = param.base().try_into_primitive::<CaptureBackend>() {
            self.of.insert(tensor.id(), self.path.join("."));
        }
    }

    fn visit_bool<const D: usize>(&mut self, param: &Param<Tensor<D, Bool>>) {
        if let Ok(tensor) = param.base().try_into_primitive::<CaptureBackend>() {
            self.of.insert(tensor.id(), self.path.join("."));
        }
    }
}
