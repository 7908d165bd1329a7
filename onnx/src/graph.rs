//! The ONNX graph under construction: unique names, shared constants, pruning and encoding.

use std::collections::{BTreeMap, HashSet};

use prost::Message;

use crate::data::{FLOAT, INT64};
use crate::error::Error;
use crate::proto::StringStringEntryProto;
use crate::proto::{
    AttributeProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, TensorProto, ValueInfoProto,
};

/// A graph that grows node by node, in execution order.
#[derive(Default)]
pub(crate) struct Graph {
    proto: GraphProto,
    taken: HashSet<String>,
    /// Constants by type, shape and bytes.
    constants: BTreeMap<(i32, Vec<i64>, Vec<u8>), String>,
}

impl Graph {
    /// Takes `wish` as a name, or the first free name that starts with it.
    pub(crate) fn claim(&mut self, wish: &str) -> String {
        let mut name = wish.to_owned();
        let mut count = 0;
        while !self.taken.insert(name.clone()) {
            count += 1;
            name = format!("{wish}_{count}");
        }
        name
    }

    /// Declares the graph's inputs and outputs.
    pub(crate) fn declare(&mut self, inputs: Vec<ValueInfoProto>, outputs: Vec<ValueInfoProto>) {
        self.proto.input = inputs;
        self.proto.output = outputs;
    }

    /// Adds a constant under its own name.
    pub(crate) fn initializer(&mut self, tensor: TensorProto) {
        self.proto.initializer.push(tensor);
    }

    /// Adds a node that defines `output`.
    pub(crate) fn node(&mut self, op: &str, input: Vec<String>, output: &str, attribute: Vec<AttributeProto>) {
        let (name, output) = (format!("{op}:{output}"), vec![output.to_owned()]);
        self.proto.node.push(NodeProto { input, output, name, op_type: op.into(), attribute, ..NodeProto::default() });
    }

    /// Adds a node that defines a fresh value, and names it.
    pub(crate) fn value(&mut self, op: &str, input: Vec<String>, attribute: Vec<AttributeProto>) -> String {
        let name = self.claim(&format!("{}_of", op.to_lowercase()));
        self.node(op, input, &name, attribute);
        name
    }

    /// A list of integers, such as a shape.
    pub(crate) fn integers(&mut self, values: &[i64]) -> String {
        let bytes = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.constant("integers", INT64, vec![values.len() as i64], bytes)
    }

    /// A list of floats.
    pub(crate) fn floats(&mut self, values: &[f32]) -> String {
        let bytes = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.constant("floats", FLOAT, vec![values.len() as i64], bytes)
    }

    /// A scalar of any element type.
    pub(crate) fn scalar(&mut self, data_type: i32, bytes: Vec<u8>) -> String {
        self.constant("scalar", data_type, Vec::new(), bytes)
    }

    /// A float scalar.
    pub(crate) fn float(&mut self, value: f32) -> String {
        self.scalar(FLOAT, value.to_le_bytes().to_vec())
    }

    /// An integer scalar.
    pub(crate) fn integer(&mut self, value: i64) -> String {
        self.scalar(INT64, value.to_le_bytes().to_vec())
    }

    fn constant(&mut self, kind: &str, data_type: i32, dims: Vec<i64>, raw_data: Vec<u8>) -> String {
        let key = (data_type, dims.clone(), raw_data.clone());
        if let Some(name) = self.constants.get(&key) {
            return name.clone();
        }
        let name = self.claim(kind);
        self.initializer(TensorProto { dims, data_type, name: name.clone(), raw_data, ..TensorProto::default() });
        self.constants.insert(key, name.clone());
        name
    }

    /// The finished file.
    pub(crate) fn encode(mut self, opset: i64, metadata: &[(String, String)]) -> Result<Vec<u8>, Error> {
        prune(&mut self.proto);
        self.proto.name = "burn".into();
        let property =
            |(key, value): &(String, String)| StringStringEntryProto { key: key.clone(), value: value.clone() };
        let model = ModelProto {
            // The oldest file format that carries the opset, so that older readers take the file.
            ir_version: match opset {
                ..=18 => 8,
                19 | 20 => 9,
                21 | 22 => 10,
                _ => 11,
            },
            producer_name: "realbeam-onnx".into(),
            producer_version: env!("CARGO_PKG_VERSION").into(),
            graph: Some(self.proto),
            opset_import: vec![OperatorSetIdProto { domain: String::new(), version: opset }],
            metadata_props: metadata.iter().map(property).collect(),
            functions: Vec::new(),
        };
        let size = model.encoded_len();
        if size > i32::MAX as usize {
            return Err(Error::TooLarge { found: size });
        }
        Ok(model.encode_to_vec())
    }
}

/// Drops the nodes and constants that no output needs; returns the names of all tensors that one does.
pub(crate) fn prune(graph: &mut GraphProto) -> HashSet<String> {
    let mut needed: HashSet<String> = graph.output.iter().map(|output| output.name.clone()).collect();
    let mut kept = Vec::with_capacity(graph.node.len());
    for node in std::mem::take(&mut graph.node).into_iter().rev() {
        if node.output.iter().any(|output| needed.contains(output)) {
            // An empty name stands for an optional input that is left out.
            needed.extend(node.input.iter().filter(|input| !input.is_empty()).cloned());
            kept.push(node);
        }
    }
    kept.reverse();
    graph.node = kept;
    graph.initializer.retain(|tensor| needed.contains(&tensor.name));
    needed
}
