//! Burn's element types, scalars and tensor data in ONNX's terms.

use burn::backend::ir::ScalarIr;
use burn::backend::{BoolStore, DType, TensorData};

use crate::error::Refusal;
use crate::proto::TensorProto;

/// `TensorProto.DataType` of float32.
pub(crate) const FLOAT: i32 = 1;
/// `TensorProto.DataType` of int32.
pub(crate) const INT32: i32 = 6;
/// `TensorProto.DataType` of int64, the type of shapes and indices.
pub(crate) const INT64: i32 = 7;
/// `TensorProto.DataType` of bool.
pub(crate) const BOOL: i32 = 9;

/// `TensorProto.DataType` of a Burn element type.
pub(crate) fn element_type(dtype: DType) -> Result<i32, Refusal> {
    Ok(match dtype {
        DType::F32 => FLOAT,
        DType::U8 => 2,
        DType::I8 => 3,
        DType::U16 => 4,
        DType::I16 => 5,
        DType::I32 => INT32,
        DType::I64 => INT64,
        // A U32 store takes four bytes an element where ONNX has one.
        DType::Bool(BoolStore::Native | BoolStore::U8) => BOOL,
        DType::F16 => 10,
        DType::F64 => 11,
        DType::U32 => 12,
        DType::U64 => 13,
        DType::BF16 => 16,
        other => return Err(Refusal::DType(other)),
    })
}

/// The little-endian bytes of one element of type `dtype`.
pub(crate) fn scalar_bytes(dtype: DType, scalar: ScalarIr) -> Result<Vec<u8>, Refusal> {
    Ok(match dtype {
        DType::F32 => scalar.elem::<f32>().to_le_bytes().to_vec(),
        DType::F64 => scalar.elem::<f64>().to_le_bytes().to_vec(),
        DType::I32 => scalar.elem::<i32>().to_le_bytes().to_vec(),
        DType::I64 => scalar.elem::<i64>().to_le_bytes().to_vec(),
        DType::Bool(BoolStore::Native | BoolStore::U8) => vec![u8::from(scalar.elem::<bool>())],
        other => return Err(Refusal::DType(other)),
    })
}

/// A named constant.
pub(crate) fn tensor(name: String, data: &TensorData) -> Result<TensorProto, Refusal> {
    Ok(TensorProto {
        name,
        data_type: element_type(data.dtype())?,
        dims: data.shape().iter().map(|size| *size as i64).collect(),
        raw_data: data.bytes().to_vec(),
        ..TensorProto::default()
    })
}
