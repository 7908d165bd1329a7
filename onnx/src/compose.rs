//! Composing: two files as one, in which the second takes what the first gives.

mod symbols;

use std::collections::BTreeSet;

use crate::cut::BASE;
use crate::data::INT64;
use crate::file::{File, FileError};
use crate::proto::{
    AttributeProto, DimensionValue, NodeProto, OperatorSetIdProto, StringStringEntryProto, TensorProto, ValueInfoProto,
};
pub use symbols::Disagreement;
use symbols::Symbols;

/// Stands before the names of the tensors of a composed file that come from its top.
const TOP: &str = "top/";

/// The axis along which an input is split: the channels of `[batch, channel, …]`.
const CHANNELS: usize = 1;

/// Two files as one: a base, and a top that takes the base's outputs as its inputs.
///
/// ```no_run
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let (network, effects) = (std::fs::read("network.onnx")?, std::fs::read("effects.onnx")?);
/// let both = onnx::Composition::new()
///     .wire("range", "range")
///     .wire("keep", "keep")
///     .split("noise")
///     .metadata("licence", "MIT")
///     .compose(&network, &effects)?;
/// let network_again = onnx::base_of(&both, &["range", "keep"])?;
/// # Ok(())
/// # }
/// ```
///
/// Inputs of the top that no wire feeds are inputs of the whole; where the base has one of the same name, both take the same tensor,
/// or, if it is [split](Self::split), each its own channels. The outputs of the whole are the top's. All other tensors of the base get
/// `base/` before their names, those of the top `top/`, and nothing is left out, so that [`cut`](crate::cut()) and
/// [`base_of`](crate::base_of) can take the whole apart again. An axis is free in the whole where it is in both.
#[derive(Clone, Debug, Default)]
pub struct Composition {
    /// Output of the base, input of the top.
    wires: Vec<(String, String)>,
    splits: Vec<String>,
    metadata: Vec<StringStringEntryProto>,
}

/// Why two files do not go together.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ComposeError {
    /// The base cannot be read.
    #[error("base: {0}")]
    Base(#[source] FileError),
    /// The top cannot be read.
    #[error("top: {0}")]
    Top(#[source] FileError),
    /// One operator set in two versions.
    #[error("operator set `{domain}`: the base has version {base}, the top {top}")]
    Opset {
        /// Its domain; ONNX's own is `ai.onnx`.
        domain: String,
        /// The base's version.
        base: i64,
        /// The top's version.
        top: i64,
    },
    /// A wire begins where the base has no output.
    #[error("wire from `{wire}`: the base has no such output; there are: {}", known.join(", "))]
    NoOutput {
        /// The output asked for.
        wire: String,
        /// Outputs that there are.
        known: Vec<String>,
    },
    /// A wire ends where the top has no input.
    #[error("wire to `{wire}`: the top has no such input; there are: {}", known.join(", "))]
    NoInput {
        /// The input asked for.
        wire: String,
        /// Inputs that there are.
        known: Vec<String>,
    },
    /// Two wires end at one input.
    #[error("two wires lead to the top's input `{wire}`")]
    WiredTwice {
        /// The input.
        wire: String,
    },
    /// An input that both take, or the ends of a wire, differ in type or shape.
    #[error("`{from}` of the base and `{to}` of the top: {problem}")]
    Disagree {
        /// Tensor of the base.
        from: String,
        /// Tensor of the top.
        to: String,
        /// What differs.
        problem: Disagreement,
    },
    /// An input that is to be split has no fixed number of channels.
    #[error("input `{input}` cannot be split: its axis {CHANNELS} is not a fixed number in both files")]
    Split {
        /// The input.
        input: String,
    },
    /// The two together are no file.
    #[error("the two together: {0}")]
    Whole(#[source] FileError),
}

impl Composition {
    /// A composition without wires.
    pub fn new() -> Self {
        Self::default()
    }

    /// Feeds an input of the top with an output of the base.
    #[must_use]
    pub fn wire(mut self, from: &str, to: &str) -> Self {
        self.wires.push((from.into(), to.into()));
        self
    }

    /// Where both files have this input, the base takes its first channels (axis 1) and the top those after them, each as many as it
    /// had; otherwise both would take the same.
    #[must_use]
    pub fn split(mut self, input: &str) -> Self {
        self.splits.push(input.into());
        self
    }

    /// Adds a metadata property; none is taken over from the files.
    #[must_use]
    pub fn metadata(mut self, key: &str, value: &str) -> Self {
        self.metadata.push(StringStringEntryProto { key: key.into(), value: value.into() });
        self
    }

    /// The bytes of the whole; the same files give the same bytes.
    ///
    /// # Errors
    /// Files that cannot be read, or that do not go together: see [`ComposeError`].
    pub fn compose(&self, base: &[u8], top: &[u8]) -> Result<Vec<u8>, ComposeError> {
        let mut base = File::read(base).map_err(ComposeError::Base)?;
        let mut top = File::read(top).map_err(ComposeError::Top)?;
        let opsets = merge_opsets(&base.opsets, &top.opsets)?;
        self.check_wires(&base, &top)?;
        let has_input = |file: &File, name: &str| file.graph.input.iter().any(|input| input.name == name);
        let splits: BTreeSet<&str> = self
            .splits
            .iter()
            .map(String::as_str)
            .filter(|name| has_input(&base, name) && has_input(&top, name))
            .collect();
        self.agree_on_axes(&mut base, &mut top, &splits)?;

        let (base_inputs, top_inputs) = (std::mem::take(&mut base.graph.input), std::mem::take(&mut top.graph.input));
        let names = |infos: &[ValueInfoProto]| infos.iter().map(|info| info.name.clone()).collect::<BTreeSet<_>>();
        let (of_base, of_top, outputs) = (names(&base_inputs), names(&top_inputs), names(&top.graph.output));
        base.rename(
            |name| match (splits.contains(name), of_base.contains(name)) {
                (true, _) => format!("base:{name}"),
                (_, true) => name.into(),
                _ => format!("{BASE}{name}"),
            },
            |name| format!("{BASE}{name}"),
        );
        top.rename(
            |name| match self.wires.iter().find(|(_, to)| to == name) {
                Some((from, _)) => format!("{BASE}{from}"),
                None if splits.contains(name) => format!("top:{name}"),
                None if of_top.contains(name) || outputs.contains(name) => name.into(),
                None => format!("{TOP}{name}"),
            },
            |name| format!("{TOP}{name}"),
        );

        let mut whole =
            File { opsets, metadata: self.metadata.clone(), ir_version: base.ir_version.max(top.ir_version), ..base };
        let (graph, top) = (&mut whole.graph, top.graph);
        graph.value_info.append(&mut graph.output);
        for mut input in base_inputs {
            if splits.contains(input.name.as_str()) {
                let others = top_inputs.iter().find(|other| other.name == input.name);
                let (node, sizes) =
                    split(&mut input, others).ok_or(ComposeError::Split { input: input.name.clone() })?;
                graph.node.insert(0, node);
                graph.initializer.push(sizes);
            }
            graph.input.push(input);
        }
        let is_wired = |name: &str| self.wires.iter().any(|(_, to)| to == name);
        graph.input.extend(top_inputs.into_iter().filter(|i| !is_wired(&i.name) && !of_base.contains(&i.name)));
        graph.node.extend(top.node);
        graph.initializer.extend(top.initializer);
        graph.value_info.extend(top.value_info);
        graph.output = top.output;
        whole.write().map_err(ComposeError::Whole)
    }

    fn check_wires(&self, base: &File, top: &File) -> Result<(), ComposeError> {
        let names = |infos: &[ValueInfoProto]| infos.iter().map(|info| info.name.clone()).collect::<Vec<_>>();
        let (outputs, inputs) = (names(&base.graph.output), names(&top.graph.input));
        for (i, (from, to)) in self.wires.iter().enumerate() {
            if !outputs.contains(from) {
                return Err(ComposeError::NoOutput { wire: from.clone(), known: outputs });
            }
            if !inputs.contains(to) {
                return Err(ComposeError::NoInput { wire: to.clone(), known: inputs });
            }
            if self.wires[..i].iter().any(|(_, earlier)| earlier == to) {
                return Err(ComposeError::WiredTwice { wire: to.clone() });
            }
        }
        Ok(())
    }

    /// Makes the axes of both files speak of the same sizes: those of the inputs that both take, then those of the wires.
    fn agree_on_axes(&self, base: &mut File, top: &mut File, splits: &BTreeSet<&str>) -> Result<(), ComposeError> {
        let mut symbols = Symbols::default();
        let is_wired = |name: &str| self.wires.iter().any(|(_, to)| to == name);
        let shared = top.graph.input.iter().filter(|to| !is_wired(&to.name));
        let shared = shared.filter_map(|to| Some((base.graph.input.iter().find(|from| from.name == to.name)?, to)));
        let wired = self.wires.iter().filter_map(|(from, to)| {
            let from = base.graph.output.iter().find(|info| info.name == *from)?;
            Some((from, top.graph.input.iter().find(|info| info.name == *to)?))
        });
        for (from, to) in shared.chain(wired) {
            let apart = (splits.contains(to.name.as_str()) && !is_wired(&to.name)).then_some(CHANNELS);
            symbols.unify(from, to, apart).map_err(|problem| ComposeError::Disagree {
                from: from.name.clone(),
                to: to.name.clone(),
                problem,
            })?;
        }
        symbols.apply(&mut base.graph, &mut top.graph);
        Ok(())
    }
}

/// All operator sets of both files, if none comes in two versions.
fn merge_opsets(
    base: &[OperatorSetIdProto],
    top: &[OperatorSetIdProto],
) -> Result<Vec<OperatorSetIdProto>, ComposeError> {
    // Two spellings of ONNX's own domain.
    let domain =
        |opset: &OperatorSetIdProto| if opset.domain.is_empty() { "ai.onnx".into() } else { opset.domain.clone() };
    let mut merged = base.to_vec();
    for opset in top {
        match base.iter().find(|other| domain(other) == domain(opset)) {
            None => merged.push(opset.clone()),
            Some(other) if other.version == opset.version => {}
            Some(other) => {
                return Err(ComposeError::Opset { domain: domain(opset), base: other.version, top: opset.version });
            }
        }
    }
    Ok(merged)
}

/// Gives the input the channels of both, and the node, with its constant, that splits them again. `None` if either is not fixed.
fn split(input: &mut ValueInfoProto, others: Option<&ValueInfoProto>) -> Option<(NodeProto, TensorProto)> {
    let size = |info: &ValueInfoProto| {
        let dim = info.r#type.as_ref()?.tensor_type.as_ref()?.shape.as_ref()?.dim.get(CHANNELS)?;
        if let Some(DimensionValue::Size(size)) = dim.value { Some(size) } else { None }
    };
    let sizes = [size(input)?, size(others?)?];
    let dim = input.r#type.as_mut()?.tensor_type.as_mut()?.shape.as_mut()?.dim.get_mut(CHANNELS)?;
    dim.value = Some(DimensionValue::Size(sizes[0].checked_add(sizes[1])?));
    let name = &input.name;
    let constant = TensorProto {
        name: format!("split:{name}"),
        data_type: INT64,
        dims: vec![2],
        raw_data: sizes.iter().flat_map(|size| size.to_le_bytes()).collect(),
        ..TensorProto::default()
    };
    let node = NodeProto {
        name: format!("Split:{name}"),
        op_type: "Split".into(),
        input: vec![name.clone(), constant.name.clone()],
        output: vec![format!("base:{name}"), format!("top:{name}")],
        attribute: vec![AttributeProto::int("axis", CHANNELS as i64)],
        ..NodeProto::default()
    };
    Some((node, constant))
}
