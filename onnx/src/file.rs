//! A finished ONNX file, read to be changed: its graph, proven to be one that can be taken apart and put together by names alone.

use std::collections::HashSet;

use prost::Message;

use crate::proto::{
    AttributeProto, GraphProto, ModelProto, OperatorSetIdProto, StringStringEntryProto, TensorProto, ValueInfoProto,
};

/// Largest file that is read, in bytes: far above any model of ours, far below what would fill a machine's memory when unfolded.
pub const MAX_FILE_BYTES: usize = 1 << 28;

/// A file whose graph is plain: every tensor is defined once, before its first use, in this file; no graphs within the graph.
#[derive(Clone, Debug)]
pub(crate) struct File {
    pub(crate) graph: GraphProto,
    pub(crate) ir_version: i64,
    pub(crate) opsets: Vec<OperatorSetIdProto>,
    pub(crate) metadata: Vec<StringStringEntryProto>,
}

/// Why a file cannot be read, cut or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// More bytes than are read or written.
    #[error("the file has {found} bytes, expected at most {MAX_FILE_BYTES}")]
    TooLarge {
        /// Its size.
        found: usize,
    },
    /// The bytes are no protobuf of an ONNX file.
    #[error("not an ONNX file: {0}")]
    Malformed(#[from] prost::DecodeError),
    /// A field without which a file says nothing.
    #[error("not an ONNX file: field `{field}` is missing")]
    Missing {
        /// The field.
        field: &'static str,
    },
    /// Until version 3, weights were inputs too.
    #[error("the file's ir_version is {found}, expected 4 or newer")]
    IrVersion {
        /// Its version.
        found: i64,
    },
    /// Something that names alone do not move: subgraphs, functions, sparse or external tensors.
    #[error("`{place}`: {what} cannot be moved to another file")]
    Unsupported {
        /// The node or tensor, or `graph`.
        place: String,
        /// What it has.
        what: &'static str,
    },
    /// A node or output uses a tensor that nothing before it defines.
    #[error("`{user}` uses tensor `{tensor}`, which nothing before it defines")]
    Undefined {
        /// The node or output.
        user: String,
        /// The tensor.
        tensor: String,
    },
    /// One name stands for two tensors.
    #[error("the name `{tensor}` stands for two tensors")]
    DefinedTwice {
        /// The name.
        tensor: String,
    },
    /// A tensor that is to become an output, but is none of the file's.
    #[error("no node or constant of the file is called `{tensor}`")]
    NoTensor {
        /// The name asked for.
        tensor: String,
    },
    /// A tensor that is to become an output, whose type the file does not state.
    #[error("tensor `{tensor}` cannot be an output: the file does not state its type and shape")]
    Untyped {
        /// The tensor.
        tensor: String,
    },
}

impl File {
    /// Reads and checks a file.
    pub(crate) fn read(bytes: &[u8]) -> Result<Self, FileError> {
        if bytes.len() > MAX_FILE_BYTES {
            return Err(FileError::TooLarge { found: bytes.len() });
        }
        let model = ModelProto::decode(bytes)?;
        let mut graph = model.graph.ok_or(FileError::Missing { field: "graph" })?;
        if model.opset_import.is_empty() {
            return Err(FileError::Missing { field: "opset_import" });
        }
        if model.ir_version < 4 {
            return Err(FileError::IrVersion { found: model.ir_version });
        }
        if !model.functions.is_empty() {
            return Err(FileError::Unsupported { place: "graph".into(), what: "functions" });
        }
        let outputs: HashSet<&str> = graph.output.iter().map(|output| output.name.as_str()).collect();
        let is_tensor = |info: &ValueInfoProto| info.r#type.as_ref().is_some_and(|kind| kind.tensor_type.is_some());
        graph.value_info.retain(|info| is_tensor(info) && !outputs.contains(info.name.as_str()));
        check_plain(&graph)?;
        check_names(&graph)?;
        Ok(Self { graph, ir_version: model.ir_version, opsets: model.opset_import, metadata: model.metadata_props })
    }

    /// Checks the names once more and writes the file.
    pub(crate) fn write(self) -> Result<Vec<u8>, FileError> {
        check_names(&self.graph)?;
        let model = ModelProto {
            ir_version: self.ir_version,
            producer_name: "realbeam-onnx".into(),
            producer_version: env!("CARGO_PKG_VERSION").into(),
            graph: Some(self.graph),
            opset_import: self.opsets,
            metadata_props: self.metadata,
            functions: Vec::new(),
        };
        let found = model.encoded_len();
        if found > MAX_FILE_BYTES { Err(FileError::TooLarge { found }) } else { Ok(model.encode_to_vec()) }
    }

    /// Renames every tensor and gives every named node a new name. An empty name stands for an input or output that is left out.
    pub(crate) fn rename(&mut self, tensor: impl Fn(&str) -> String, node: impl Fn(&str) -> String) {
        let set = |name: &mut String, to: &dyn Fn(&str) -> String| {
            if !name.is_empty() {
                *name = to(name);
            }
        };
        let graph = &mut self.graph;
        for step in &mut graph.node {
            step.input.iter_mut().chain(&mut step.output).for_each(|name| set(name, &tensor));
            set(&mut step.name, &node);
        }
        graph.initializer.iter_mut().for_each(|constant| set(&mut constant.name, &tensor));
        let infos = graph.input.iter_mut().chain(&mut graph.output).chain(&mut graph.value_info);
        infos.for_each(|info| set(&mut info.name, &tensor));
    }
}

/// Refuses what does not move with its names.
fn check_plain(graph: &GraphProto) -> Result<(), FileError> {
    let refuse = |place: &str, what| Err(FileError::Unsupported { place: place.into(), what });
    let lies_outside = |tensor: &TensorProto| tensor.data_location != 0 || !tensor.external_data.is_empty();
    let is_sparse = |a: &AttributeProto| a.sparse_tensor.is_some() || !a.sparse_tensors.is_empty();
    if !graph.sparse_initializer.is_empty() {
        return refuse("graph", "a sparse constant");
    }
    if !graph.quantization_annotation.is_empty() {
        return refuse("graph", "a quantization annotation");
    }
    if let Some(tensor) = graph.initializer.iter().find(|tensor| lies_outside(tensor)) {
        return refuse(&tensor.name, "data outside the file");
    }
    for node in &graph.node {
        let place = node.output.iter().find(|name| !name.is_empty()).unwrap_or(&node.name);
        if node.attribute.iter().any(|a| a.g.is_some() || !a.graphs.is_empty()) {
            return refuse(place, "a subgraph");
        }
        if node.attribute.iter().any(|a| is_sparse(a) || a.t.iter().chain(&a.tensors).any(lies_outside)) {
            return refuse(place, "an attribute that is sparse or outside the file");
        }
    }
    let inputs: HashSet<&str> = graph.input.iter().map(|input| input.name.as_str()).collect();
    match graph.output.iter().find(|output| inputs.contains(output.name.as_str())) {
        Some(output) => refuse(&output.name, "an output that is an input"),
        None => Ok(()),
    }
}

/// Every tensor is defined once, and before it is used.
fn check_names(graph: &GraphProto) -> Result<(), FileError> {
    let mut defined = HashSet::new();
    let constants = graph.initializer.iter().map(|tensor| tensor.name.as_str());
    for name in graph.input.iter().map(|input| input.name.as_str()).chain(constants) {
        if !defined.insert(name) {
            return Err(FileError::DefinedTwice { tensor: name.into() });
        }
    }
    let undefined = |user: &str, tensor: &str| FileError::Undefined { user: user.into(), tensor: tensor.into() };
    for node in &graph.node {
        if let Some(input) = node.input.iter().find(|input| !input.is_empty() && !defined.contains(input.as_str())) {
            let user = if node.name.is_empty() { &node.op_type } else { &node.name };
            return Err(undefined(user, input));
        }
        for output in node.output.iter().filter(|output| !output.is_empty()) {
            if !defined.insert(output) {
                return Err(FileError::DefinedTwice { tensor: output.clone() });
            }
        }
    }
    let mut outputs = HashSet::new();
    for output in &graph.output {
        if !defined.contains(output.name.as_str()) {
            return Err(undefined("graph", &output.name));
        }
        if !outputs.insert(&output.name) {
            return Err(FileError::DefinedTwice { tensor: output.name.clone() });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{NodeProto, TensorTypeProto, TypeProto};

    fn info(name: &str) -> ValueInfoProto {
        let tensor_type = Some(TensorTypeProto { elem_type: 1, shape: None });
        ValueInfoProto { name: name.into(), r#type: Some(TypeProto { tensor_type }) }
    }

    /// y = x + c, with every field filled that a writer other than ours may use.
    fn model() -> ModelProto {
        let constant = TensorProto {
            name: "c".into(),
            data_type: 1,
            float_data: vec![1.5],
            int32_data: vec![-1],
            int64_data: vec![-2],
            uint64_data: vec![3],
            double_data: vec![0.25],
            string_data: vec![b"s".to_vec()],
            ..TensorProto::default()
        };
        let attribute = AttributeProto {
            name: "a".into(),
            floats: vec![0.5],
            strings: vec![b"t".to_vec()],
            tensors: vec![constant.clone()],
            tp: Some(vec![1]),
            type_protos: vec![vec![2]],
            ..AttributeProto::default()
        };
        let node = NodeProto {
            input: vec!["x".into(), String::new(), "c".into()],
            output: vec!["y".into()],
            op_type: "Add".into(),
            domain: "elsewhere".into(),
            attribute: vec![attribute],
            ..NodeProto::default()
        };
        let graph = GraphProto {
            node: vec![node],
            initializer: vec![constant],
            input: vec![info("x")],
            output: vec![info("y")],
            ..GraphProto::default()
        };
        let opset_import = vec![OperatorSetIdProto { domain: String::new(), version: 18 }];
        ModelProto { ir_version: 9, graph: Some(graph), opset_import, ..ModelProto::default() }
    }

    fn read(edit: impl Fn(&mut ModelProto, &mut GraphProto)) -> Result<File, FileError> {
        let mut model = model();
        let mut graph = model.graph.take().unwrap_or_default();
        edit(&mut model, &mut graph);
        model.graph.get_or_insert(graph);
        File::read(&model.encode_to_vec())
    }

    #[test]
    fn what_a_file_computes_with_survives_reading_and_writing() -> Result<(), FileError> {
        let written = ModelProto::decode(read(|_, _| {})?.write()?.as_slice())?;
        assert_eq!(written.graph, model().graph);
        assert_eq!((written.opset_import, written.ir_version), (model().opset_import, 9));
        Ok(())
    }

    #[test]
    fn what_cannot_be_moved_is_refused_by_name() {
        let refusal =
            |edit: fn(&mut ModelProto, &mut GraphProto)| read(edit).err().map(|e| e.to_string()).unwrap_or_default();
        let moved = "cannot be moved to another file";
        assert_eq!(refusal(|_, g| g.node[0].attribute[0].g = Some(vec![])), format!("`y`: a subgraph {moved}"));
        assert_eq!(refusal(|_, g| g.initializer[0].data_location = 1), format!("`c`: data outside the file {moved}"));
        assert_eq!(refusal(|_, g| g.sparse_initializer.push(vec![])), format!("`graph`: a sparse constant {moved}"));
        assert_eq!(refusal(|m, _| m.functions.push(vec![])), format!("`graph`: functions {moved}"));
        assert_eq!(refusal(|_, g| g.output[0].name = "x".into()), format!("`x`: an output that is an input {moved}"));
        assert_eq!(refusal(|m, _| m.ir_version = 3), "the file's ir_version is 3, expected 4 or newer");
        assert_eq!(refusal(|m, _| m.opset_import.clear()), "not an ONNX file: field `opset_import` is missing");
        assert_eq!(
            refusal(|_, g| g.node[0].input[0] = "z".into()),
            "`Add` uses tensor `z`, which nothing before it defines"
        );
        assert_eq!(refusal(|_, g| g.node[0].output[0] = "c".into()), "the name `c` stands for two tensors");
        assert_eq!(refusal(|_, _| {}), "");
    }
}
