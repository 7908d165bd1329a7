//! Operations on tensors of any element type: shapes, indices, masks, equality.

use burn::backend::ir::{BaseOperationIr as Base, RepeatDimOpIr, ScalarIr, ShapeOpIr, TensorIr};

use super::Lowering;
use super::dim::Dim;
use crate::data::{INT32, element_type, scalar_bytes};
use crate::error::Refusal;
use crate::proto::{AttributeProto, TensorProto};
use crate::traces::{Samples, constant};

impl Lowering<'_> {
    pub(super) fn base(&mut self, operation: &Base) -> Result<(), Refusal> {
        let axis = |axis: usize| vec![AttributeProto::int("axis", axis as i64)];
        match operation {
            Base::Reshape(reshape) => self.reshape(reshape)?,
            Base::SwapDims(swap) => {
                let mut order: Vec<usize> = (0..swap.input.shape.num_dims()).collect();
                order.swap(swap.dim1, swap.dim2);
                self.emit("Transpose", &[&swap.input], &swap.out, vec![AttributeProto::ints("perm", &order)]);
            }
            Base::Permute(permute) => {
                let order = vec![AttributeProto::ints("perm", &permute.axes)];
                self.emit("Transpose", &[&permute.input], &permute.out, order);
            }
            Base::Flip(flip) => self.flip(flip),
            Base::Expand(expand) => self.expand(expand)?,
            Base::RepeatDim(repeat) => self.repeat(repeat)?,
            Base::Slice(slice) => self.slice(slice)?,
            Base::Cat(cat) => self.emit("Concat", &cat.tensors.iter().collect::<Vec<_>>(), &cat.out, axis(cat.dim)),
            Base::Select(select) => {
                self.emit("Gather", &[&select.tensor, &select.indices], &select.out, axis(select.dim));
            }
            Base::Gather(gather) => {
                self.emit("GatherElements", &[&gather.tensor, &gather.indices], &gather.out, axis(gather.dim));
            }
            Base::MaskWhere(mask) => self.emit("Where", &[&mask.mask, &mask.value, &mask.tensor], &mask.out, vec![]),
            Base::MaskFill(fill) => {
                let value = self.scalar(fill.tensor.dtype, fill.value)?;
                let inputs = vec![self.name(&fill.mask), value, self.name(&fill.tensor)];
                self.emit_named("Where", inputs, &fill.out, Vec::new());
            }
            Base::Equal(pair) => self.emit("Equal", &[&pair.lhs, &pair.rhs], &pair.out, vec![]),
            Base::EqualElem(scalar) => self.emit_scalar("Equal", scalar)?,
            Base::NotEqual(pair) => {
                let inputs = vec![self.name(&pair.lhs), self.name(&pair.rhs)];
                self.not_equal(inputs, &pair.out);
            }
            Base::NotEqualElem(scalar) => {
                let inputs = vec![self.name(&scalar.lhs), self.scalar(scalar.lhs.dtype, scalar.rhs)?];
                self.not_equal(inputs, &scalar.out);
            }
            Base::All(reduce) => self.truth("ReduceMin", &reduce.input, None, &reduce.out)?,
            Base::Any(reduce) => self.truth("ReduceMax", &reduce.input, None, &reduce.out)?,
            Base::AllDim(reduce) => self.truth("ReduceMin", &reduce.input, Some(reduce.axis), &reduce.out)?,
            Base::AnyDim(reduce) => self.truth("ReduceMax", &reduce.input, Some(reduce.axis), &reduce.out)?,
            Base::Cast(cast) => self.cast(cast)?,
            Base::Zeros(zeros) => self.full(&zeros.out, ScalarIr::Int(0))?,
            Base::Ones(ones) => self.full(&ones.out, ScalarIr::Int(1))?,
            _ => return Err(Refusal::NoCounterpart("")),
        }
        Ok(())
    }

    /// A tensor with one value everywhere.
    pub(super) fn full(&mut self, out: &TensorIr, value: ScalarIr) -> Result<(), Refusal> {
        let shape = self.shape_of(out.id)?;
        let (data_type, raw_data) = (element_type(out.dtype)?, scalar_bytes(out.dtype, value)?);
        let value = TensorProto { data_type, dims: vec![1], raw_data, ..TensorProto::default() };
        self.emit_named("ConstantOfShape", vec![shape], out, vec![AttributeProto::tensor("value", value)]);
        Ok(())
    }

    /// The target shape says 0 where the input has the same size in the same place, and −1 at one more place, which makes
    /// it right at every size; only what is left over is computed.
    fn reshape(&mut self, reshape: &ShapeOpIr) -> Result<(), Refusal> {
        let traces = self.traces;
        let (from, to) = (traces.dims(reshape.input.id), traces.dims(reshape.out.id));
        let mut target: Vec<Option<i64>> = to
            .iter()
            .enumerate()
            .map(|(axis, samples)| constant(samples).or_else(|| (from.get(axis) == Some(samples)).then_some(0)))
            .collect();
        if target.iter().filter(|size| size.is_none()).count() == 1 {
            for size in &mut target {
                size.get_or_insert(-1);
            }
        }
        let shape = match target.into_iter().collect::<Option<Vec<i64>>>() {
            Some(sizes) => self.graph.integers(&sizes),
            None => self.shape_of(reshape.out.id)?,
        };
        let inputs = vec![self.name(&reshape.input), shape];
        self.emit_named("Reshape", inputs, &reshape.out, Vec::new());
        Ok(())
    }

    /// ONNX broadcasts both ways, so the target says 1 where the input has the size already.
    fn expand(&mut self, expand: &ShapeOpIr) -> Result<(), Refusal> {
        let traces = self.traces;
        let (from, to) = (traces.dims(expand.input.id), traces.dims(expand.out.id));
        let added = to.len() - from.len();
        let size = |(axis, samples): (usize, &Samples)| {
            let kept = axis >= added && from[axis - added] == *samples;
            if kept { Ok(Dim::Constant(1)) } else { self.dim(samples) }
        };
        let dims = to.iter().enumerate().map(size).collect::<Result<Vec<_>, _>>()?;
        let inputs = vec![self.name(&expand.input), self.shape(&dims)];
        self.emit_named("Expand", inputs, &expand.out, Vec::new());
        Ok(())
    }

    fn repeat(&mut self, repeat: &RepeatDimOpIr) -> Result<(), Refusal> {
        let traces = self.traces;
        let (from, to) = (&traces.dims(repeat.tensor.id)[repeat.dim], &traces.dims(repeat.out.id)[repeat.dim]);
        let times: Samples = from.iter().zip(to).map(|(from, to)| to / from.max(&1)).collect();
        let mut dims = vec![Dim::Constant(1); repeat.tensor.shape.num_dims()];
        dims[repeat.dim] = self.dim(&times)?;
        let inputs = vec![self.name(&repeat.tensor), self.shape(&dims)];
        self.emit_named("Tile", inputs, &repeat.out, Vec::new());
        Ok(())
    }

    fn not_equal(&mut self, inputs: Vec<String>, out: &TensorIr) {
        let equal = self.graph.value("Equal", inputs, Vec::new());
        self.emit_named("Not", vec![equal], out, Vec::new());
    }

    /// `All` is the minimum of truth values, `Any` the maximum; ONNX reduces numbers only.
    fn truth(&mut self, op: &str, input: &TensorIr, axis: Option<usize>, out: &TensorIr) -> Result<(), Refusal> {
        let input = self.name(input);
        // Burn's `any` over numbers asks for non-zero ones, as a cast to bool does.
        let truth = self.cast_to(input, crate::data::BOOL);
        let number = self.cast_to(truth, INT32);
        let reduced = self.reduced(op, number, axis);
        self.emit_named(
            "Cast",
            vec![reduced],
            out,
            vec![AttributeProto::int("to", i64::from(element_type(out.dtype)?))],
        );
        Ok(())
    }

    pub(super) fn cast_to(&mut self, value: String, element_type: i32) -> String {
        self.graph.value("Cast", vec![value], vec![AttributeProto::int("to", i64::from(element_type))])
    }
}
