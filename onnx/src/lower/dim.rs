//! Sizes at run time: a number that followed the dynamic axes in the traces, written as a computation in the graph.

use burn::backend::capture::TensorId;
use burn::backend::ir::{OperationIr, TensorIr};

use super::Lowering;
use crate::error::Refusal;
use crate::proto::AttributeProto;
use crate::traces::{Samples, constant};

/// A size in the graph.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Dim {
    /// The same at every size.
    Constant(i64),
    /// A dynamic axis itself.
    Symbol(usize),
    /// The size of an earlier tensor.
    Of(TensorId, usize),
    /// `numerator · product(symbols) / denominator + offset`, in integers.
    Affine { symbols: Vec<usize>, numerator: i64, denominator: i64, offset: i64 },
}

impl Lowering<'_> {
    /// Finds what a number is. The size of a live tensor goes before arithmetic: it is right at every size, while an
    /// expression such as `h / 2` can hide a truth of `(h + 1) / 2`.
    pub(super) fn dim(&self, samples: &[i64]) -> Result<Dim, Refusal> {
        if let Some(value) = constant(samples) {
            return Ok(Dim::Constant(value));
        }
        if let Some(symbol) = self.symbols.iter().position(|symbol| symbol.samples == samples) {
            return Ok(Dim::Symbol(symbol));
        }
        self.live(samples).or_else(|| self.affine(samples)).ok_or_else(|| Refusal::SizeUnknown {
            found: samples.to_vec(),
            symbols: self
                .symbols
                .iter()
                .map(|symbol| format!("{} {:?}", symbol.name, symbol.samples))
                .collect::<Vec<_>>()
                .join(", "),
        })
    }

    /// The nearest tensor before this operation with an axis of that size; one that several operations read, if there is
    /// any, because asking a convolution's output for its shape keeps runtimes from fusing what follows into it.
    fn live(&self, samples: &[i64]) -> Option<Dim> {
        let before = &self.traces.base().operations[..self.index];
        let axis = |tensor: &TensorIr| self.traces.dims(tensor.id).iter().position(|sizes| sizes == samples);
        let mut candidates = before
            .iter()
            .rev()
            .flat_map(OperationIr::outputs)
            .filter(|tensor| !self.norms.within.contains(&tensor.id))
            .filter_map(|tensor| Some((tensor.id, axis(tensor)?)));
        let nearest = candidates.next()?;
        let shared = |(tensor, _): &(TensorId, usize)| self.readers.get(tensor).is_some_and(|readers| *readers > 1);
        let (tensor, axis) = std::iter::once(nearest).chain(candidates).find(shared).unwrap_or(nearest);
        Some(Dim::Of(tensor, axis))
    }

    /// An affine expression of one symbol, or of a product of two or three, that fits every trace.
    fn affine(&self, samples: &[i64]) -> Option<Dim> {
        let count = self.symbols.len();
        let mut products: Vec<Vec<usize>> = (0..count).map(|a| vec![a]).collect();
        products.extend((0..count).flat_map(|a| (a + 1..count).map(move |b| vec![a, b])));
        products.extend(
            (0..count).flat_map(|a| (a + 1..count).flat_map(move |b| (b + 1..count).map(move |c| vec![a, b, c]))),
        );
        products.into_iter().find_map(|symbols| {
            let product: Samples = (0..samples.len())
                .map(|trace| symbols.iter().map(|s| self.symbols[*s].samples[trace]).product())
                .collect();
            let (numerator, denominator, offset) = fit(&product, samples)?;
            Some(Dim::Affine { symbols, numerator, denominator, offset })
        })
    }

    /// A one-element integer tensor that holds the size at run time.
    pub(super) fn size(&mut self, dim: &Dim) -> String {
        if let Dim::Constant(value) = dim {
            return self.graph.integers(&[*value]);
        }
        if let Some(name) = self.sizes.get(dim) {
            return name.clone();
        }
        let name = match dim {
            Dim::Constant(value) => self.graph.integers(&[*value]),
            Dim::Symbol(symbol) => {
                let symbol = &self.symbols[*symbol];
                self.size_of(symbol.input.clone(), symbol.axis)
            }
            Dim::Of(tensor, axis) => {
                let graph = &mut self.graph;
                let tensor = self.names.entry(*tensor).or_insert_with(|| graph.claim("value")).clone();
                self.size_of(tensor, *axis)
            }
            Dim::Affine { symbols, numerator, denominator, offset } => {
                let factors: Vec<String> = symbols.iter().map(|symbol| self.size(&Dim::Symbol(*symbol))).collect();
                let product = factors.into_iter().reduce(|a, b| self.graph.value("Mul", vec![a, b], Vec::new()));
                let mut value = product.unwrap_or_else(|| self.graph.integers(&[1]));
                for (op, operand, neutral) in [("Mul", *numerator, 1), ("Div", *denominator, 1), ("Add", *offset, 0)] {
                    if operand != neutral {
                        let operand = self.graph.integers(&[operand]);
                        value = self.graph.value(op, vec![value, operand], Vec::new());
                    }
                }
                value
            }
        };
        self.sizes.insert(dim.clone(), name.clone());
        name
    }

    fn size_of(&mut self, tensor: String, axis: usize) -> String {
        let range = vec![AttributeProto::int("start", axis as i64), AttributeProto::int("end", axis as i64 + 1)];
        self.graph.value("Shape", vec![tensor], range)
    }

    /// A shape as an integer tensor, constant where every size is.
    pub(super) fn shape(&mut self, dims: &[Dim]) -> String {
        let constants: Option<Vec<i64>> =
            dims.iter().map(|dim| if let Dim::Constant(value) = dim { Some(*value) } else { None }).collect();
        if let Some(constants) = constants {
            return self.graph.integers(&constants);
        }
        let parts = dims.iter().map(|dim| self.size(dim)).collect();
        self.graph.value("Concat", parts, vec![AttributeProto::int("axis", 0)])
    }

    /// The shape of a tensor.
    pub(super) fn shape_of(&mut self, tensor: TensorId) -> Result<String, Refusal> {
        let traces = self.traces;
        let dims = traces.dims(tensor).iter().map(|samples| self.dim(samples)).collect::<Result<Vec<_>, _>>()?;
        Ok(self.shape(&dims))
    }
}

/// `(numerator, denominator, offset)` with `y = numerator · x / denominator + offset`, exact in every trace.
fn fit(x: &[i64], y: &[i64]) -> Option<(i64, i64, i64)> {
    let grown = (1..x.len()).find(|trace| x[*trace] != x[0])?;
    let (rise, run) = (y[grown] - y[0], x[grown] - x[0]);
    let divisor = gcd(rise.abs(), run.abs()).max(1) * run.signum();
    let (numerator, denominator) = (rise / divisor, run / divisor);
    let exact = x.iter().all(|x| (numerator * x) % denominator == 0);
    let offset = y[0] - numerator * x[0] / denominator;
    let fits = x.iter().zip(y).all(|(x, y)| numerator * x / denominator + offset == *y);
    (exact && fits).then_some((numerator, denominator, offset))
}

fn gcd(a: i64, b: i64) -> i64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_affine_size_is_found_and_a_rounded_one_is_not() {
        assert_eq!(fit(&[64, 80, 112], &[35, 43, 59]), Some((1, 2, 3)));
        assert_eq!(fit(&[64, 65, 67, 70], &[32, 33, 34, 35]), None, "(w + 1) / 2 is no affine expression");
        assert_eq!(fit(&[4, 8], &[9, 7]), Some((-1, 2, 11)));
    }
}
