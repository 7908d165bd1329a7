//! Slices and flips: bounds that stay right at every size.

use burn::backend::Slice;
use burn::backend::ir::{BaseOperationIr, FlipOpIr, OperationIr, SliceOpIr};

use super::Lowering;
use super::dim::Dim;
use crate::error::Refusal;
use crate::traces::{Samples, constant};

impl Lowering<'_> {
    /// Burn stores the bounds of a slice clamped to the traced shape, `start < end` also where the step is negative: the
    /// range selects elements, the sign of the step their order.
    pub(super) fn slice(&mut self, slice: &SliceOpIr) -> Result<(), Refusal> {
        let (mut starts, mut ends, mut axes, mut steps) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (axis, range) in slice.ranges.iter().enumerate() {
            let sizes = self.traces.dims(slice.tensor.id)[axis].clone();
            let first = self.bound(&sizes, axis, |range, _| range.start as i64);
            let end = self.bound(&sizes, axis, |range, size| range.end.map_or(size, |end| end as i64));
            if range.step == 1 && first.iter().all(|first| *first == 0) && end == sizes {
                continue;
            }
            let before = |samples: &Samples| samples.iter().map(|sample| sample - 1).collect::<Samples>();
            let (start, stop) = if range.step > 0 { (first, end) } else { (before(&end), before(&first)) };
            starts.push(self.counted(&start, &sizes)?);
            // Going down to index 0, the bound −1 would mean the last element.
            let to_the_front = range.step < 0 && constant(&stop) == Some(-1);
            ends.push(if to_the_front { Dim::Constant(i64::MIN) } else { self.counted(&stop, &sizes)? });
            axes.push(axis as i64);
            steps.push(range.step as i64);
        }
        if axes.is_empty() {
            self.emit("Identity", &[&slice.tensor], &slice.out, Vec::new());
            return Ok(());
        }
        let mut inputs =
            vec![self.name(&slice.tensor), self.shape(&starts), self.shape(&ends), self.graph.integers(&axes)];
        if steps.iter().any(|step| *step != 1) {
            inputs.push(self.graph.integers(&steps));
        }
        self.emit_named("Slice", inputs, &slice.out, Vec::new());
        Ok(())
    }

    /// A flip is a slice with step −1 from the last element to the first.
    pub(super) fn flip(&mut self, flip: &FlipOpIr) {
        let axes: Vec<i64> = flip.axes.iter().map(|axis| *axis as i64).collect();
        let repeated = |value: i64| vec![value; axes.len()];
        let (last, front, back) = (repeated(-1), repeated(i64::MIN), repeated(-1));
        let inputs = vec![
            self.name(&flip.input),
            self.graph.integers(&last),
            self.graph.integers(&front),
            self.graph.integers(&axes),
            self.graph.integers(&back),
        ];
        self.emit_named("Slice", inputs, &flip.out, Vec::new());
    }

    /// One bound of this operation's range over `axis`, in every trace.
    fn bound(&self, sizes: &[i64], axis: usize, read: impl Fn(&Slice, i64) -> i64) -> Samples {
        let range = |operation: &OperationIr| match operation {
            OperationIr::BaseFloat(BaseOperationIr::Slice(slice))
            | OperationIr::BaseInt(BaseOperationIr::Slice(slice))
            | OperationIr::BaseBool(BaseOperationIr::Slice(slice)) => slice.ranges.get(axis).copied(),
            _ => None,
        };
        let ranges = self.traces.read(self.index, range);
        ranges.iter().zip(sizes).map(|(range, size)| read(&range.unwrap_or(Slice::full()), *size)).collect()
    }

    /// A bound counted from the front or from the back, whichever is constant; else an expression of the sizes.
    fn counted(&self, bound: &[i64], sizes: &[i64]) -> Result<Dim, Refusal> {
        if let Some(front) = constant(bound)
            && front >= 0
        {
            return Ok(Dim::Constant(front));
        }
        let back: Samples = bound.iter().zip(sizes).map(|(bound, size)| bound - size).collect();
        match constant(&back) {
            // Counted from the back, the end itself has no number.
            Some(0) => Ok(Dim::Constant(i64::MAX)),
            Some(back) if back < 0 => Ok(Dim::Constant(back)),
            _ => self.dim(bound),
        }
    }
}
