//! ONNX Runtime, as a function from a file and its inputs to its outputs.

use std::path::Path;

use burn::tensor::{DType, TensorData};
use ort::environment::Environment;
use ort::session::builder::GraphOptimizationLevel;
use ort::session::{Session, SessionInputValue};
use ort::value::{Tensor, TensorElementType};

fn environment() -> Environment {
    ::runtime::environment().unwrap()
}

/// Runs a file; inputs and outputs in the graph's order.
pub(crate) fn run(file: &[u8], inputs: &[TensorData]) -> Vec<TensorData> {
    let mut session =
        Session::builder(&environment()).unwrap().with_intra_threads(1).unwrap().commit_from_memory(file).unwrap();
    let names: Vec<String> = session.inputs().iter().map(|input| input.name().to_owned()).collect();
    let values: Vec<(String, SessionInputValue<'_>)> = names.into_iter().zip(inputs.iter().map(value)).collect();
    let outputs = session.run(values).unwrap();
    outputs.values().map(|output| data(&output)).collect()
}

/// Writes the file as ONNX Runtime would execute it, after its optimisations that hold on every machine.
pub(crate) fn optimise(file: &[u8], to: &Path) {
    let builder =
        Session::builder(&environment()).unwrap().with_optimization_level(GraphOptimizationLevel::Level2).unwrap();
    builder.with_optimized_model_path(to).unwrap().commit_from_memory(file).unwrap();
}

fn value(data: &TensorData) -> SessionInputValue<'static> {
    let shape: Vec<i64> = data.shape().iter().map(|size| *size as i64).collect();
    match data.dtype() {
        DType::F32 => Tensor::from_array((shape, data.iter::<f32>().collect::<Vec<_>>())).unwrap().into(),
        // The file's integers are int64, whatever Flex has.
        DType::I32 | DType::I64 => Tensor::from_array((shape, data.iter::<i64>().collect::<Vec<_>>())).unwrap().into(),
        DType::Bool(_) => Tensor::from_array((shape, data.iter::<bool>().collect::<Vec<_>>())).unwrap().into(),
        other => panic!("no test feeds {other:?}"),
    }
}

fn data(value: &ort::value::DynValue) -> TensorData {
    fn data<T: ort::value::PrimitiveTensorElementType + burn::tensor::Element>(
        value: &ort::value::DynValue,
    ) -> TensorData {
        let (shape, values) = value.try_extract_tensor::<T>().unwrap();
        TensorData::new(values.to_vec(), shape.iter().map(|size| *size as usize).collect::<Vec<_>>())
    }
    match value.dtype().tensor_type().unwrap() {
        TensorElementType::Float32 => data::<f32>(value),
        TensorElementType::Int32 => data::<i32>(value),
        TensorElementType::Int64 => data::<i64>(value),
        TensorElementType::Bool => data::<bool>(value),
        other => panic!("no test reads {other:?}"),
    }
}

/// Inputs and outputs as ONNX Runtime reads them, for example `scan: f32 [batch, 3, 64, column]`.
pub(crate) fn describe(file: &[u8]) -> Vec<String> {
    let session = Session::builder(&environment()).unwrap().commit_from_memory(file).unwrap();
    let one = |outlet: &ort::value::Outlet| {
        let ort::value::ValueType::Tensor { ty, shape, dimension_symbols } = outlet.dtype() else {
            panic!("no tensor")
        };
        let sizes: Vec<String> = shape
            .iter()
            .zip(dimension_symbols.iter())
            .map(|(size, symbol)| if symbol.is_empty() { size.to_string() } else { symbol.clone() })
            .collect();
        format!("{}: {ty} [{}]", outlet.name(), sizes.join(", "))
    };
    session.inputs().iter().chain(session.outputs()).map(one).collect()
}

/// A metadata property of a file.
pub(crate) fn metadata(file: &[u8], key: &str) -> Option<String> {
    let session = Session::builder(&environment()).unwrap().commit_from_memory(file).unwrap();
    session.metadata().unwrap().custom(key)
}
