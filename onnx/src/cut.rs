//! Cutting: the part of a file that leads to some of its tensors.

use std::collections::HashSet;

use crate::file::{File, FileError};
use crate::graph::prune;
use crate::proto::{DimensionValue, GraphProto};

/// Stands before the names of the tensors of a composed file that come from its base.
pub(crate) const BASE: &str = "base/";

/// The same file with these tensors as its outputs, without the nodes, constants and inputs that none of them needs.
///
/// The file must state the type and shape of each, as [`Composition`](crate::Composition) does for what the base gives. Of an input
/// that [was split](crate::Composition::split) the channels that are still needed stay.
///
/// # Errors
/// A file that cannot be read, and a tensor that is not there or has no stated type.
pub fn cut(onnx: &[u8], outputs: &[&str]) -> Result<Vec<u8>, FileError> {
    cut_file(onnx, outputs)?.write()
}

/// The base of a [composed](crate::Composition) file, with these of its outputs and all the names that it had: of a base that an
/// [`Exporter`](crate::Exporter) wrote, with all its outputs, the very bytes, but for the metadata, which stay the composed file's, for
/// inputs that it does not use, and for free axes that the composition had to fix.
///
/// # Errors
/// As [`cut`]: above all a file that was not composed, or whose base has no such output.
pub fn base_of(onnx: &[u8], outputs: &[&str]) -> Result<Vec<u8>, FileError> {
    let inside: Vec<String> = outputs.iter().map(|output| format!("{BASE}{output}")).collect();
    let inside: Vec<&str> = inside.iter().map(String::as_str).collect();
    let mut file = cut_file(onnx, &inside)?;
    let bare = |name: &str| name.strip_prefix(BASE).unwrap_or(name).to_owned();
    file.rename(bare, bare);
    file.write()
}

fn cut_file(onnx: &[u8], outputs: &[&str]) -> Result<File, FileError> {
    let mut file = File::read(onnx)?;
    let graph = &mut file.graph;
    let stated: Vec<_> =
        std::mem::take(&mut graph.output).into_iter().chain(std::mem::take(&mut graph.value_info)).collect();
    for tensor in outputs {
        let made = graph.node.iter().flat_map(|node| &node.output).chain(graph.initializer.iter().map(|t| &t.name));
        if !made.into_iter().any(|name| name == tensor) {
            return Err(FileError::NoTensor { tensor: (*tensor).into() });
        }
        let info = stated.iter().find(|info| info.name == *tensor);
        graph.output.push(info.ok_or_else(|| FileError::Untyped { tensor: (*tensor).into() })?.clone());
    }
    let needed = prune(graph);
    narrow_split_inputs(graph, &needed);
    let used: HashSet<&str> = graph.node.iter().flat_map(|node| &node.input).map(String::as_str).collect();
    graph.input.retain(|input| used.contains(input.name.as_str()));
    graph.initializer.retain(|tensor| used.contains(tensor.name.as_str()) || outputs.contains(&tensor.name.as_str()));
    graph.value_info = stated
        .into_iter()
        .filter(|info| needed.contains(&info.name) && !outputs.contains(&info.name.as_str()))
        .collect();
    Ok(file)
}

/// Takes a `Split` away whose first part alone is needed, and which alone needs its input: the input becomes that part.
fn narrow_split_inputs(graph: &mut GraphProto, needed: &HashSet<String>) {
    for place in (0..graph.node.len()).rev() {
        let node = &graph.node[place];
        let ([whole, sizes], [first, others @ ..]) = (node.input.as_slice(), node.output.as_slice()) else { continue };
        if node.op_type != "Split" {
            continue;
        }
        let users = graph.node.iter().flat_map(|node| &node.input).filter(|input| *input == whole).count();
        let is_output = graph.output.iter().any(|output| output.name == *first);
        let alone = users == 1 && !is_output && !others.iter().any(|other| needed.contains(other));
        if !alone {
            continue;
        }
        let (axis, (whole, first)) = (node.attribute.iter().find_map(|a| a.i), (whole.clone(), first.clone()));
        let sizes = graph.initializer.iter().find(|tensor| tensor.name == *sizes);
        let size = sizes.and_then(|tensor| tensor.raw_data.first_chunk()).map(|bytes| i64::from_le_bytes(*bytes));
        let input = graph.input.iter_mut().find(|input| input.name == whole);
        let dims = input.and_then(|input| Some(&mut input.r#type.as_mut()?.tensor_type.as_mut()?.shape.as_mut()?.dim));
        let dim = dims.and_then(|dims| dims.get_mut(usize::try_from(axis?).ok()?));
        let (Some(size), Some(dim)) = (size, dim) else { continue };
        dim.value = Some(DimensionValue::Size(size));
        graph.node.remove(place);
        let uses = graph.node.iter_mut().flat_map(|node| &mut node.input);
        uses.filter(|input| **input == first).for_each(|input| input.clone_from(&whole));
    }
}
