//! Dynamic axes of the graph's inputs, and the sizes at which the forward pass is traced.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Index;

use crate::error::Error;

/// A free axis: one symbol, which may lie on several inputs, where it then has one size.
#[derive(Clone, Debug)]
pub struct Axis {
    pub(crate) symbol: String,
    pub(crate) base: usize,
    pub(crate) multiple: usize,
    pub(crate) places: Vec<(String, usize)>,
}

impl Axis {
    /// A dynamic axis called `symbol`; `base` is about the smallest size that the forward pass can be traced at (reflective
    /// padding by 3 needs 4, for example).
    pub fn new(symbol: &str, base: usize) -> Self {
        Self { symbol: symbol.into(), base, multiple: 1, places: Vec::new() }
    }

    /// The sizes, `base` among them, that the graph has to be right for: multiples of `multiple`. A network that halves its
    /// columns four times needs 16.
    #[must_use]
    pub fn multiple_of(mut self, multiple: usize) -> Self {
        self.multiple = multiple;
        self
    }

    /// The axis is `axis` of the input called `input`.
    #[must_use]
    pub fn on(mut self, input: &str, axis: usize) -> Self {
        self.places.push((input.into(), axis));
        self
    }

    /// Checks the axis against the names of the inputs.
    pub(crate) fn check(&self, inputs: &[String]) -> Result<(), Error> {
        if let Some((input, _)) = self.places.iter().find(|(input, _)| !inputs.contains(input)) {
            return Err(Error::UnknownInput { symbol: self.symbol.clone(), input: input.clone() });
        }
        if self.base == 0 || self.multiple == 0 || !self.base.is_multiple_of(self.multiple) || self.places.is_empty() {
            return Err(Error::InvalidAxis {
                symbol: self.symbol.clone(),
                base: self.base,
                multiple: self.multiple,
                places: self.places.len(),
            });
        }
        Ok(())
    }

    /// The base size, grown `steps` times by the granularity. Size 1 is left out, because Burn takes shortcuts there
    /// (it broadcasts instead of repeating), and a trace of a shortcut does not show the general case.
    fn size(&self, steps: usize) -> usize {
        let first = if self.base == 1 { 1 + self.multiple } else { self.base };
        first + steps * self.multiple
    }
}

/// The size of each dynamic axis in one trace; `sizes["batch"]` reads one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sizes(BTreeMap<String, usize>);

impl Sizes {
    /// The sizes to trace at, for `k` axes: the base; each axis grown alone, which tells the axes apart; and all grown at
    /// once, twice and by odd steps, which gives away a product of sizes and a rounded division.
    pub(crate) fn plan(axes: &[Axis]) -> Vec<Self> {
        let at = |steps: &dyn Fn(usize) -> usize| {
            Self(axes.iter().enumerate().map(|(i, axis)| (axis.symbol.clone(), axis.size(steps(i)))).collect())
        };
        let mut plan = vec![at(&|_| 0)];
        if !axes.is_empty() {
            plan.extend((0..axes.len()).map(|grown| at(&|i| usize::from(i == grown))));
            plan.push(at(&|i| 3 + 2 * i));
            plan.push(at(&|i| 6 + 3 * i));
        }
        plan
    }
}

impl Index<&str> for Sizes {
    type Output = usize;

    /// # Panics
    /// If no dynamic axis has this name: a slip in the closure that makes the inputs.
    fn index(&self, symbol: &str) -> &usize {
        &self.0[symbol]
    }
}

impl fmt::Display for Sizes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts: Vec<String> = self.0.iter().map(|(symbol, size)| format!("{symbol} {size}")).collect();
        f.write_str(&parts.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_trace_size_keeps_the_granularity_and_none_is_one() {
        let axes = [Axis::new("batch", 1).on("x", 0), Axis::new("column", 64).multiple_of(16).on("x", 3)];
        let plan = Sizes::plan(&axes);
        assert_eq!(plan.len(), 5);
        assert!(plan.iter().all(|sizes| sizes["column"] % 16 == 0 && sizes["batch"] > 1));
        assert!(plan.iter().any(|sizes| (sizes["column"] / 16) % 2 == 1), "an odd multiple shows a rounded division");
    }

    #[test]
    fn a_graph_without_dynamic_axes_is_traced_once() {
        assert_eq!(Sizes::plan(&[]).len(), 1);
    }
}
