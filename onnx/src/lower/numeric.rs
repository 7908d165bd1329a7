//! Arithmetic, comparisons, reductions and padding of numbers.

use burn::backend::ir::{
    NumericOperationIr as Numeric, PadModeIr, PadOpIr, ReduceDimOpIr, ReduceDimWithIndicesOpIr, ReduceDimsOpIr,
    TensorIr,
};

use super::Lowering;
use crate::data::{INT64, element_type};
use crate::error::Refusal;
use crate::proto::AttributeProto;

impl Lowering<'_> {
    pub(super) fn numeric(&mut self, operation: &Numeric) -> Result<(), Refusal> {
        if let Some((op, pair)) = binary(operation) {
            self.emit(op, &[&pair.lhs, &pair.rhs], &pair.out, vec![]);
            return Ok(());
        }
        match operation {
            Numeric::AddScalar(scalar) => self.emit_scalar("Add", scalar)?,
            Numeric::SubScalar(scalar) => self.emit_scalar("Sub", scalar)?,
            Numeric::MulScalar(scalar) => self.emit_scalar("Mul", scalar)?,
            Numeric::DivScalar(scalar) => self.emit_scalar("Div", scalar)?,
            Numeric::GreaterElem(scalar) => self.emit_scalar("Greater", scalar)?,
            Numeric::GreaterEqualElem(scalar) => self.emit_scalar("GreaterOrEqual", scalar)?,
            Numeric::LowerElem(scalar) => self.emit_scalar("Less", scalar)?,
            Numeric::LowerEqualElem(scalar) => self.emit_scalar("LessOrEqual", scalar)?,
            Numeric::ClampMin(scalar) => self.emit_scalar("Max", scalar)?,
            Numeric::ClampMax(scalar) => self.emit_scalar("Min", scalar)?,
            // The product is exact where a power goes through the logarithm.
            Numeric::PowiScalar(scalar) if scalar.rhs.elem::<f64>() == 2.0 => {
                self.emit("Mul", &[&scalar.lhs, &scalar.lhs], &scalar.out, vec![]);
            }
            Numeric::PowiScalar(scalar) => self.emit_scalar("Pow", scalar)?,
            Numeric::Rem(pair) => {
                let (x, y) = (self.name(&pair.lhs), self.name(&pair.rhs));
                self.remainder(x, y, &pair.out);
            }
            Numeric::RemScalar(scalar) => {
                let (x, y) = (self.name(&scalar.lhs), self.scalar(scalar.lhs.dtype, scalar.rhs)?);
                self.remainder(x, y, &scalar.out);
            }
            Numeric::Clamp(clamp) => {
                let dtype = clamp.tensor.dtype;
                let inputs =
                    vec![self.name(&clamp.tensor), self.scalar(dtype, clamp.min)?, self.scalar(dtype, clamp.max)?];
                self.emit_named("Clip", inputs, &clamp.out, Vec::new());
            }
            Numeric::Abs(unary) => self.emit("Abs", &[&unary.input], &unary.out, vec![]),
            Numeric::Neg(unary) => self.emit("Neg", &[&unary.input], &unary.out, vec![]),
            Numeric::Sign(unary) => self.emit("Sign", &[&unary.input], &unary.out, vec![]),
            Numeric::Full(full) => self.full(&full.out, full.value)?,
            Numeric::CumSum(sum) => {
                let inputs = vec![self.name(&sum.input), self.graph.integer(sum.axis as i64)];
                self.emit_named("CumSum", inputs, &sum.out, Vec::new());
            }
            Numeric::Pad(pad) => self.pad(pad)?,
            Numeric::IntRandom(_) => return Err(Refusal::Random),
            other => return self.reduction(other),
        }
        Ok(())
    }

    fn reduction(&mut self, operation: &Numeric) -> Result<(), Refusal> {
        match operation {
            Numeric::Mean(reduce) => self.reduce_all("ReduceMean", &reduce.input, &reduce.out),
            Numeric::Sum(reduce) => self.reduce_all("ReduceSum", &reduce.input, &reduce.out),
            Numeric::Prod(reduce) => self.reduce_all("ReduceProd", &reduce.input, &reduce.out),
            Numeric::Max(reduce) => self.reduce_all("ReduceMax", &reduce.input, &reduce.out),
            Numeric::Min(reduce) => self.reduce_all("ReduceMin", &reduce.input, &reduce.out),
            Numeric::MeanDim(reduce) => self.reduce_axis("ReduceMean", reduce),
            Numeric::SumDim(reduce) => self.reduce_axis("ReduceSum", reduce),
            Numeric::ProdDim(reduce) => self.reduce_axis("ReduceProd", reduce),
            Numeric::MaxDim(reduce) => self.reduce_axis("ReduceMax", reduce),
            Numeric::MinDim(reduce) => self.reduce_axis("ReduceMin", reduce),
            Numeric::SumDims(reduce) => self.reduce_axes("ReduceSum", reduce),
            Numeric::ArgMax(reduce) => self.arg("ArgMax", &reduce.input, reduce.axis, &reduce.out)?,
            Numeric::ArgMin(reduce) => self.arg("ArgMin", &reduce.input, reduce.axis, &reduce.out)?,
            Numeric::MaxDimWithIndices(reduce) => self.reduce_with_indices(["ReduceMax", "ArgMax"], reduce)?,
            Numeric::MinDimWithIndices(reduce) => self.reduce_with_indices(["ReduceMin", "ArgMin"], reduce)?,
            _ => return Err(Refusal::NoCounterpart("")),
        }
        Ok(())
    }

    /// Over one axis, kept with length 1, or over all of them.
    pub(super) fn reduced(&mut self, op: &str, input: String, axis: Option<usize>) -> String {
        let mut inputs = vec![input];
        inputs.extend(axis.map(|axis| self.graph.integers(&[axis as i64])));
        let reduced = self.graph.value(op, inputs, vec![AttributeProto::int("keepdims", i64::from(axis.is_some()))]);
        if axis.is_some() {
            return reduced;
        }
        // Burn's scalars are vectors of one element.
        let one = self.graph.integers(&[1]);
        self.graph.value("Reshape", vec![reduced, one], Vec::new())
    }

    fn reduce_all(&mut self, op: &str, input: &TensorIr, out: &TensorIr) {
        let input = self.name(input);
        let reduced = self.graph.value(op, vec![input], vec![AttributeProto::int("keepdims", 0)]);
        let one = self.graph.integers(&[1]);
        self.emit_named("Reshape", vec![reduced, one], out, Vec::new());
    }

    fn reduce_axis(&mut self, op: &str, reduce: &ReduceDimOpIr) {
        let inputs = vec![self.name(&reduce.input), self.graph.integers(&[reduce.axis as i64])];
        self.emit_named(op, inputs, &reduce.out, vec![AttributeProto::int("keepdims", 1)]);
    }

    fn reduce_axes(&mut self, op: &str, reduce: &ReduceDimsOpIr) {
        let axes: Vec<i64> = reduce.axes.iter().map(|axis| *axis as i64).collect();
        let inputs = vec![self.name(&reduce.input), self.graph.integers(&axes)];
        self.emit_named(op, inputs, &reduce.out, vec![AttributeProto::int("keepdims", 1)]);
    }

    fn reduce_with_indices(&mut self, ops: [&str; 2], reduce: &ReduceDimWithIndicesOpIr) -> Result<(), Refusal> {
        let inputs = vec![self.name(&reduce.tensor), self.graph.integers(&[reduce.dim as i64])];
        self.emit_named(ops[0], inputs, &reduce.out, vec![AttributeProto::int("keepdims", 1)]);
        self.arg(ops[1], &reduce.tensor, reduce.dim, &reduce.out_indices)
    }

    fn arg(&mut self, op: &str, input: &TensorIr, axis: usize, out: &TensorIr) -> Result<(), Refusal> {
        let settings = vec![AttributeProto::int("axis", axis as i64), AttributeProto::int("keepdims", 1)];
        let to = element_type(out.dtype)?;
        if to == INT64 {
            self.emit(op, &[input], out, settings);
        } else {
            let input = self.name(input);
            let index = self.graph.value(op, vec![input], settings);
            self.emit_named("Cast", vec![index], out, vec![AttributeProto::int("to", i64::from(to))]);
        }
        Ok(())
    }

    /// `x − ⌊x / y⌋ · y`, with the sign of y; ONNX's `Mod` has that sign for integers only.
    fn remainder(&mut self, x: String, y: String, out: &TensorIr) {
        if out.dtype.is_float() {
            let quotient = self.graph.value("Div", vec![x.clone(), y.clone()], Vec::new());
            let floor = self.graph.value("Floor", vec![quotient], Vec::new());
            let whole = self.graph.value("Mul", vec![floor, y], Vec::new());
            self.emit_named("Sub", vec![x, whole], out, Vec::new());
        } else {
            self.emit_named("Mod", vec![x, y], out, Vec::new());
        }
    }

    fn pad(&mut self, pad: &PadOpIr) -> Result<(), Refusal> {
        let widths: Vec<i64> =
            pad.padding.iter().map(|pair| pair.0 as i64).chain(pad.padding.iter().map(|pair| pair.1 as i64)).collect();
        let mut inputs = vec![self.name(&pad.input), self.graph.integers(&widths)];
        let mode = match pad.mode {
            PadModeIr::Constant(value) => {
                inputs.push(self.scalar(pad.input.dtype, value)?);
                "constant"
            }
            PadModeIr::Reflect => "reflect",
            PadModeIr::Edge => "edge",
        };
        self.emit_named("Pad", inputs, &pad.out, vec![AttributeProto::text("mode", mode)]);
        Ok(())
    }
}

/// The operations over two tensors that ONNX has under one name.
fn binary(operation: &Numeric) -> Option<(&'static str, &burn::backend::ir::BinaryOpIr)> {
    Some(match operation {
        Numeric::Add(pair) => ("Add", pair),
        Numeric::Sub(pair) => ("Sub", pair),
        Numeric::Mul(pair) => ("Mul", pair),
        Numeric::Div(pair) => ("Div", pair),
        Numeric::Powi(pair) => ("Pow", pair),
        Numeric::Greater(pair) => ("Greater", pair),
        Numeric::GreaterEqual(pair) => ("GreaterOrEqual", pair),
        Numeric::Lower(pair) => ("Less", pair),
        Numeric::LowerEqual(pair) => ("LessOrEqual", pair),
        _ => return None,
    })
}
