//! Sizes of two graphs that are put together: which symbol of the one is which size or symbol of the other.

use std::collections::{BTreeMap, HashSet};
use std::fmt;

use crate::proto::{Dimension, DimensionValue, GraphProto, TensorTypeProto, ValueInfoProto};

/// What the symbols of two graphs turn out to be.
#[derive(Debug, Default)]
pub(super) struct Symbols {
    /// Sizes of the base's symbols.
    base: BTreeMap<String, i64>,
    /// Sizes of the top's symbols, or what the base calls them.
    top: BTreeMap<String, DimensionValue>,
}

/// Two tensors that should be one differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Disagreement {
    /// Type and shape on the base's side.
    pub base: String,
    /// Type and shape on the top's side.
    pub top: String,
}

impl fmt::Display for Disagreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "one is {}, the other {}", self.base, self.top)
    }
}

impl Symbols {
    /// Learns from two tensors that are to be one. The size of axis `apart` may differ.
    pub(super) fn unify(
        &mut self,
        base: &ValueInfoProto,
        top: &ValueInfoProto,
        apart: Option<usize>,
    ) -> Result<(), Disagreement> {
        let disagree = || Disagreement { base: describe(base), top: describe(top) };
        let (Some(from), Some(to)) = (tensor_type(base), tensor_type(top)) else { return Err(disagree()) };
        if from.elem_type != to.elem_type {
            return Err(disagree());
        }
        // A tensor without a shape fits every other.
        let (Some(from), Some(to)) = (&from.shape, &to.shape) else { return Ok(()) };
        if from.dim.len() != to.dim.len() {
            return Err(disagree());
        }
        for (axis, (from, to)) in from.dim.iter().zip(&to.dim).enumerate() {
            if let (Some(from), Some(to)) = (&from.value, &to.value)
                && apart != Some(axis)
            {
                self.unify_sizes(from, to).ok_or_else(disagree)?;
            }
        }
        Ok(())
    }

    /// `None` if the two cannot be one.
    fn unify_sizes(&mut self, base: &DimensionValue, top: &DimensionValue) -> Option<()> {
        let known = match top {
            DimensionValue::Size(_) => top.clone(),
            DimensionValue::Symbol(symbol) => self.top.entry(symbol.clone()).or_insert_with(|| base.clone()).clone(),
        };
        match (self.of_base(base), self.of_base(&known)) {
            (DimensionValue::Size(a), DimensionValue::Size(b)) => (a == b).then_some(()),
            (DimensionValue::Size(size), DimensionValue::Symbol(symbol))
            | (DimensionValue::Symbol(symbol), DimensionValue::Size(size)) => {
                self.base.insert(symbol, size);
                Some(())
            }
            // Two names of the base for what is one size to the top: the first one stays.
            (DimensionValue::Symbol(_), DimensionValue::Symbol(_)) => Some(()),
        }
    }

    /// What is known of a size of the base.
    fn of_base(&self, value: &DimensionValue) -> DimensionValue {
        match value {
            DimensionValue::Symbol(symbol) => self.base.get(symbol).map_or(value.clone(), |s| DimensionValue::Size(*s)),
            DimensionValue::Size(_) => value.clone(),
        }
    }

    /// Writes what was learned into both graphs. A symbol of the top that nothing was learned of gets a name that the base does not use.
    pub(super) fn apply(&self, base: &mut GraphProto, top: &mut GraphProto) {
        let mut taken = HashSet::new();
        for dim in dims(base) {
            if let Some(DimensionValue::Symbol(symbol)) = &dim.value {
                taken.insert(symbol.clone());
            }
            dim.value = dim.value.as_ref().map(|value| self.of_base(value));
        }
        for dim in dims(top) {
            let Some(DimensionValue::Symbol(symbol)) = &mut dim.value else { continue };
            match self.top.get(symbol) {
                Some(value) => dim.value = Some(self.of_base(value)),
                None => {
                    while taken.contains(symbol) {
                        *symbol = format!("top_{symbol}");
                    }
                }
            }
        }
    }
}

/// All stated sizes of a graph.
fn dims(graph: &mut GraphProto) -> impl Iterator<Item = &mut Dimension> {
    let infos = graph.input.iter_mut().chain(&mut graph.output).chain(&mut graph.value_info);
    infos.filter_map(|info| info.r#type.as_mut()?.tensor_type.as_mut()?.shape.as_mut()).flat_map(|shape| &mut shape.dim)
}

fn tensor_type(info: &ValueInfoProto) -> Option<&TensorTypeProto> {
    info.r#type.as_ref()?.tensor_type.as_ref()
}

/// For example `float32 [batch, 3, 64, column]`.
fn describe(info: &ValueInfoProto) -> String {
    let Some(kind) = tensor_type(info) else { return "no tensor".into() };
    let element = match kind.elem_type {
        1 => "float32".into(),
        6 => "int32".into(),
        7 => "int64".into(),
        9 => "bool".into(),
        other => format!("element type {other}"),
    };
    let axis = |dim: &Dimension| match &dim.value {
        Some(DimensionValue::Size(size)) => size.to_string(),
        Some(DimensionValue::Symbol(symbol)) => symbol.clone(),
        None => "?".into(),
    };
    match &kind.shape {
        Some(shape) => format!("{element} [{}]", shape.dim.iter().map(axis).collect::<Vec<_>>().join(", ")),
        None => format!("{element} of any shape"),
    }
}
