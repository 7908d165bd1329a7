//! The messages of `onnx.proto`, cut down to the fields that are read here.

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Model {
    #[prost(message, optional, tag = "7")]
    pub(super) graph: Option<Graph>,
    #[prost(message, repeated, tag = "14")]
    pub(super) metadata_props: Vec<Entry>,
    #[prost(message, repeated, tag = "25")]
    pub(super) functions: Vec<Function>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Entry {
    #[prost(string, tag = "1")]
    pub(super) key: String,
    #[prost(string, tag = "2")]
    pub(super) value: String,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Function {
    #[prost(message, repeated, tag = "7")]
    pub(super) node: Vec<Node>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Graph {
    #[prost(message, repeated, tag = "1")]
    pub(super) node: Vec<Node>,
    #[prost(message, repeated, tag = "5")]
    pub(super) initializer: Vec<Weight>,
    #[prost(message, repeated, tag = "11")]
    pub(super) input: Vec<ValueInfo>,
    #[prost(message, repeated, tag = "12")]
    pub(super) output: Vec<ValueInfo>,
    #[prost(message, repeated, tag = "15")]
    pub(super) sparse_initializer: Vec<SparseWeight>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Node {
    #[prost(string, tag = "4")]
    pub(super) op_type: String,
    #[prost(message, repeated, tag = "5")]
    pub(super) attribute: Vec<Attribute>,
    #[prost(string, tag = "7")]
    pub(super) domain: String,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Attribute {
    #[prost(message, optional, tag = "5")]
    pub(super) t: Option<Weight>,
    #[prost(message, optional, tag = "6")]
    pub(super) g: Option<Graph>,
    #[prost(message, repeated, tag = "10")]
    pub(super) tensors: Vec<Weight>,
    #[prost(message, repeated, tag = "11")]
    pub(super) graphs: Vec<Graph>,
    #[prost(message, optional, tag = "22")]
    pub(super) sparse_tensor: Option<SparseWeight>,
    #[prost(message, repeated, tag = "23")]
    pub(super) sparse_tensors: Vec<SparseWeight>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Weight {
    #[prost(string, tag = "8")]
    pub(super) name: String,
    #[prost(message, repeated, tag = "13")]
    pub(super) external_data: Vec<Entry>,
    #[prost(int32, tag = "14")]
    pub(super) data_location: i32,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct SparseWeight {
    #[prost(message, optional, tag = "1")]
    pub(super) values: Option<Weight>,
    #[prost(message, optional, tag = "2")]
    pub(super) indices: Option<Weight>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct ValueInfo {
    #[prost(string, tag = "1")]
    pub(super) name: String,
    #[prost(message, optional, tag = "2")]
    pub(super) r#type: Option<Type>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Type {
    #[prost(message, optional, tag = "1")]
    pub(super) tensor_type: Option<TensorType>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct TensorType {
    #[prost(int32, tag = "1")]
    pub(super) elem_type: i32,
    #[prost(message, optional, tag = "2")]
    pub(super) shape: Option<Shape>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Shape {
    #[prost(message, repeated, tag = "1")]
    pub(super) dim: Vec<Dimension>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Dimension {
    #[prost(oneof = "DimensionValue", tags = "1, 2")]
    pub(super) value: Option<DimensionValue>,
}

#[derive(Clone, PartialEq, prost::Oneof)]
pub(super) enum DimensionValue {
    #[prost(int64, tag = "1")]
    Length(i64),
    #[prost(string, tag = "2")]
    Name(String),
}

impl Graph {
    /// Name of a weight, here or in a subgraph, that lies outside the file.
    pub(super) fn external_tensor(&self) -> Option<&str> {
        let weights = self.initializer.iter().chain(self.sparse_initializer.iter().flat_map(SparseWeight::parts));
        let own = weights.filter(|w| w.is_external()).map(|w| w.name.as_str()).next();
        own.or_else(|| self.node.iter().find_map(Node::external_tensor))
    }
}

impl Node {
    /// This node, or one in its subgraphs, if its operator is none of ONNX's own.
    pub(super) fn foreign(&self) -> Option<&Self> {
        if !matches!(self.domain.as_str(), "" | "ai.onnx") {
            return Some(self);
        }
        let graphs = self.attribute.iter().flat_map(|attribute| attribute.g.iter().chain(&attribute.graphs));
        graphs.flat_map(|graph| &graph.node).find_map(Self::foreign)
    }

    /// As [`Graph::external_tensor`], for a node's attributes.
    pub(super) fn external_tensor(&self) -> Option<&str> {
        self.attribute.iter().find_map(|attribute| {
            let sparse = attribute.sparse_tensor.iter().chain(&attribute.sparse_tensors).flat_map(SparseWeight::parts);
            let mut weights = attribute.t.iter().chain(&attribute.tensors).chain(sparse);
            let own = weights.find(|w| w.is_external()).map(|w| w.name.as_str());
            own.or_else(|| attribute.g.iter().chain(&attribute.graphs).find_map(Graph::external_tensor))
        })
    }
}

impl Weight {
    fn is_external(&self) -> bool {
        self.data_location != 0 || !self.external_data.is_empty()
    }
}

impl SparseWeight {
    fn parts(&self) -> impl Iterator<Item = &Weight> {
        self.values.iter().chain(&self.indices)
    }
}
