//! Exports a forward pass and compares Burn with ONNX Runtime at several sizes.

use burn::module::Module;
use burn::tensor::{Bool, Float, Int, Tensor, TensorData};
use onnx::{Axis, Boundary, Exporter, Sizes};

use crate::sample::{Function, floats};
use crate::{checker, runtime};

/// Float32 rounding over the few thousand additions of these small tensors, relative to 1 + |value|. A wrong ε of a norm
/// is ten times larger: see `norms::a_wrong_epsilon_is_seen`.
pub(crate) const TOLERANCE: f32 = 1e-5;

/// Sizes of the free axes.
#[derive(Clone, Copy)]
pub(crate) struct At {
    pub batch: usize,
    pub column: usize,
}

/// Tensors that can be read back outside of a capture.
pub(crate) trait Readable: Boundary {
    fn read(self) -> Vec<TensorData>;
}

macro_rules! readable_tensor {
    ($($kind:ty),+) => { $(impl<const D: usize> Readable for Tensor<D, $kind> {
        fn read(self) -> Vec<TensorData> {
            vec![self.into_data()]
        }
    })+ };
}
macro_rules! readable_tuple {
    ($($part:ident $index:tt),+) => { impl<$($part: Readable),+> Readable for ($($part,)+) {
        fn read(self) -> Vec<TensorData> {
            let mut read = Vec::new();
            $(read.extend(self.$index.read());)+
            read
        }
    } };
}
readable_tensor!(Float, Int, Bool);
readable_tuple!(A 0, B 1);
readable_tuple!(A 0, B 1, C 2);
readable_tuple!(A 0, B 1, C 2, E 3);

/// A forward pass under test.
pub(crate) struct Case<M, F, G> {
    pub module: M,
    /// Makes the inputs.
    pub inputs: F,
    pub forward: G,
    /// Columns come in multiples of this.
    pub multiple: usize,
}

impl<M: Module, I: Readable, O: Readable, F: Fn(At) -> I, G: Fn(&M, I) -> O> Case<M, F, G> {
    /// The file with batch and column free on every input that has them.
    pub(crate) fn export(&self) -> Vec<u8> {
        self.exporter().export(&self.module, |sizes| (self.inputs)(at(sizes)), &self.forward).unwrap()
    }

    /// An exporter that names inputs `x0`, `x1`, … and outputs `y0`, `y1`, …
    pub(crate) fn exporter(&self) -> Exporter {
        let base = At { batch: 2, column: 4 * self.multiple };
        let other = At { batch: 3, column: 5 * self.multiple };
        let shapes =
            |at: At| (self.inputs)(at).read().into_iter().map(|data| data.shape().to_vec()).collect::<Vec<_>>();
        let mut batch = Axis::new("batch", base.batch);
        let mut column = Axis::new("column", base.column).multiple_of(self.multiple);
        let (mut has_batch, mut has_column) = (false, false);
        let mut exporter = Exporter::new();
        for (index, (small, large)) in shapes(base).iter().zip(shapes(other)).enumerate() {
            let name = format!("x{index}");
            for (axis, (small, large)) in small.iter().zip(large).enumerate() {
                if (*small, large) == (base.batch, other.batch) {
                    (batch, has_batch) = (batch.on(&name, axis), true);
                } else if (*small, large) == (base.column, other.column) {
                    (column, has_column) = (column.on(&name, axis), true);
                }
            }
            exporter = exporter.input(&name);
        }
        if has_batch {
            exporter = exporter.dynamic(batch);
        }
        if has_column {
            exporter = exporter.dynamic(column);
        }
        let outputs = (self.forward)(&self.module, (self.inputs)(base)).read().len();
        (0..outputs).fold(exporter, |exporter, index| exporter.output(&format!("y{index}")))
    }

    /// The largest difference between Burn and the file, relative to 1 + |value|, over sizes that were never traced.
    pub(crate) fn difference(&self, file: &[u8]) -> f32 {
        let sizes =
            [(1, 3), (2, 4), (5, 11), (3, 8)].map(|(batch, columns)| At { batch, column: columns * self.multiple });
        sizes.into_iter().fold(0.0, |worst, at| {
            let expected = (self.forward)(&self.module, (self.inputs)(at)).read();
            let found = runtime::run(file, &(self.inputs)(at).read());
            assert_eq!(expected.len(), found.len());
            expected.iter().zip(&found).fold(worst, |worst, (expected, found)| worst.max(difference(expected, found)))
        })
    }

    /// Asserts that the file passes the checker and agrees with Burn.
    pub(crate) fn agrees(&self) {
        let file = self.export();
        assert!(checker::verdict(&file).is_none_or(|verdict| verdict == "ok"), "{:?}", checker::verdict(&file));
        let difference = self.difference(&file);
        assert!(difference <= TOLERANCE, "difference {difference:e}");
    }
}

fn at(sizes: &Sizes) -> At {
    // A graph without a free axis is traced once, and any size will do.
    let size = |symbol: &str, otherwise| if sizes.to_string().contains(symbol) { sizes[symbol] } else { otherwise };
    At { batch: size("batch", 2), column: size("column", 4) }
}

/// The largest difference of two tensors, relative to 1 + |value|.
pub(crate) fn difference(expected: &TensorData, found: &TensorData) -> f32 {
    assert_eq!(expected.shape(), found.shape());
    assert_eq!(expected.dtype().is_float(), found.dtype().is_float(), "{:?} and {:?}", expected.dtype(), found.dtype());
    if !expected.dtype().is_float() {
        let same = expected.iter::<i64>().eq(found.iter::<i64>());
        return if same { 0.0 } else { f32::INFINITY };
    }
    expected.iter::<f32>().zip(found.iter::<f32>()).fold(0.0, |worst, (expected, found)| {
        let alike = expected == found || (expected.is_nan() && found.is_nan());
        let difference = (expected - found).abs() / (1.0 + expected.abs());
        // A NaN against a number is as wrong as can be.
        worst.max(if alike {
            0.0
        } else if difference.is_nan() {
            f32::INFINITY
        } else {
            difference
        })
    })
}

/// Asserts that a function of `[batch, 3, 4, column]` floats, or of several tensors, agrees.
pub(crate) fn function_agrees<I: Readable, O: Readable>(inputs: impl Fn(At) -> I, forward: impl Fn(I) -> O) {
    Case { module: Function {}, inputs, forward: |_: &Function, input| forward(input), multiple: 1 }.agrees();
}

/// One tensor of `[batch, 3, 4, column]` floats.
pub(crate) fn image(at: At) -> Tensor<4> {
    floats([at.batch, 3, 4, at.column], 1)
}

/// Two of them.
pub(crate) fn images(at: At) -> (Tensor<4>, Tensor<4>) {
    (image(at), floats([at.batch, 3, 4, at.column], 2))
}

/// A small file.
pub(crate) fn export_of_a_sum() -> Vec<u8> {
    Case {
        module: Function {},
        inputs: images,
        forward: |_: &Function, (a, b): (Tensor<4>, Tensor<4>)| a + b,
        multiple: 1,
    }
    .export()
}

#[test]
fn a_wrong_number_is_seen() {
    let case = |offset: f32| Case {
        module: Function {},
        inputs: image,
        forward: move |_: &Function, x: Tensor<4>| x + offset,
        multiple: 1,
    };
    let file = case(1.0).export();
    assert_eq!(case(1.0).difference(&file), 0.0);
    assert!(case(1.0 + 1e-4).difference(&file) > TOLERANCE);
}
