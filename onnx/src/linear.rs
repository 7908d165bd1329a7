//! Puts linear maps back together that Burn records as matrix products.
//!
//! Burn folds the leading axes of a linear map's input into its rows or leaves them, whichever tiles better at the size at
//! hand, so one layer takes two courses at two sizes. As one operation it takes one.

use std::collections::{HashMap, HashSet};
use std::iter::once;

use burn::backend::capture::TensorId;
use burn::backend::ir::{
    BaseOperationIr, FloatOperationIr, LinearOpIr, MatmulOpIr, ModuleOperationIr, NumericOperationIr, OperationIr,
    ShapeOpIr, TensorIr,
};

/// The operations with each `reshape? · matmul · (bias reshape · add)? · reshape?` that is a linear map as one operation.
/// `outputs` are read from outside.
pub(crate) fn recognise(operations: &[OperationIr], outputs: &[TensorIr]) -> Vec<OperationIr> {
    let mut reads: HashMap<TensorId, usize> = HashMap::new();
    for tensor in operations.iter().flat_map(OperationIr::inputs).chain(outputs) {
        *reads.entry(tensor.id).or_default() += 1;
    }
    let mut recognised = Vec::with_capacity(operations.len());
    let mut rest = operations;
    while let Some(operation) = rest.first() {
        if let Some((linear, length)) = linear(rest, &reads) {
            recognised.push(OperationIr::Module(ModuleOperationIr::Linear(linear)));
            rest = &rest[length..];
        } else {
            recognised.push(operation.clone());
            rest = &rest[1..];
        }
    }
    recognised
}

/// The linear map at the head of `operations`, and the number of operations that it spans.
fn linear(operations: &[OperationIr], reads: &HashMap<TensorId, usize>) -> Option<(LinearOpIr, usize)> {
    let (before, matmul) = match operations {
        [head, next, ..] if reshape(head).is_some() => (reshape(head), matmul(next)?),
        [head, ..] => (None, matmul(head)?),
        [] => return None,
    };
    let mut length = 1 + usize::from(before.is_some());
    let mut inner = HashSet::new();
    let (x, weight, folded) = match before {
        None => (&matmul.lhs, &matmul.rhs, false),
        Some(fold) if fold.out.id == matmul.lhs.id && folds_rows(fold) => (&fold.input, &matmul.rhs, true),
        Some(lift) if lift.out.id == matmul.rhs.id => (&matmul.lhs, &lift.input, false),
        Some(_) => return None,
    };
    inner.extend(before.map(|before| before.out.id));
    if weight.shape.num_dims() != 2 {
        return None;
    }
    let mut out = &matmul.out;
    let mut bias = None;
    if let Some((vector, lifted, sum)) = bias_of(&operations[length..], out, weight.shape[1]) {
        inner.extend([out.id, lifted]);
        (bias, out, length) = (Some(vector.clone()), sum, length + 2);
    }
    if folded {
        let unfold = operations.get(length).and_then(reshape).filter(|unfold| unfold.input.id == out.id)?;
        let whole = x.shape.iter().rev().skip(1).rev().copied().chain(once(weight.shape[1]));
        if !whole.eq(unfold.out.shape.iter().copied()) {
            return None;
        }
        inner.insert(out.id);
        (out, length) = (&unfold.out, length + 1);
    }
    // A step that something else reads as well has to stay.
    let private = inner.iter().all(|tensor| reads.get(tensor) == Some(&1));
    private.then(|| (LinearOpIr { x: x.clone(), weight: weight.clone(), bias, out: out.clone() }, length))
}

/// The bias vector, its lifted form and the sum, if the next two operations add one to every row of `product`.
fn bias_of<'a>(
    next: &'a [OperationIr],
    product: &TensorIr,
    columns: usize,
) -> Option<(&'a TensorIr, TensorId, &'a TensorIr)> {
    let [lift, OperationIr::NumericFloat(_, NumericOperationIr::Add(add)), ..] = next else { return None };
    let lift = reshape(lift)?;
    let vector = lift.input.shape.num_dims() == 1 && lift.input.shape[0] == columns;
    let along_rows = lift.out.shape.iter().last() == Some(&columns);
    let adds = add.lhs.id == product.id && add.rhs.id == lift.out.id;
    (vector && along_rows && adds).then_some((&lift.input, lift.out.id, &add.out))
}

/// Whether a reshape makes rows of all axes but the last.
fn folds_rows(reshape: &ShapeOpIr) -> bool {
    reshape.out.shape.num_dims() == 2 && reshape.input.shape.iter().last() == reshape.out.shape.iter().last()
}

fn reshape(operation: &OperationIr) -> Option<&ShapeOpIr> {
    match operation {
        OperationIr::BaseFloat(BaseOperationIr::Reshape(reshape)) => Some(reshape),
        _ => None,
    }
}

fn matmul(operation: &OperationIr) -> Option<&MatmulOpIr> {
    match operation {
        OperationIr::Float(_, FloatOperationIr::Matmul(matmul)) => Some(matmul),
        _ => None,
    }
}
