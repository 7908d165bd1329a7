//! The answer of `infer`, to a body's bytes.

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::{DATATYPE, Tensor};

/// What a model gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The model's name.
    pub model_name: String,
    /// The version that made it.
    pub model_version: String,
    /// The request's id.
    pub id: Option<String>,
    /// What the answer says besides.
    pub parameters: Map<String, Value>,
    /// The outputs, each with whether it goes as bytes after the JSON.
    pub outputs: Vec<(Tensor, bool)>,
}

#[derive(Serialize)]
struct Head<'a> {
    model_name: &'a str,
    model_version: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    id: Option<&'a str>,
    #[serde(skip_serializing_if = "Map::is_empty")]
    parameters: &'a Map<String, Value>,
    outputs: Vec<Output<'a>>,
}

#[derive(Serialize)]
struct Output<'a> {
    name: &'a str,
    datatype: &'static str,
    shape: &'a [usize],
    #[serde(skip_serializing_if = "Option::is_none")]
    parameters: Option<Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    data: Option<&'a [f32]>,
}

impl Answer {
    /// The body, and how many of its bytes are JSON where tensors follow it. A number that is none is `null` in JSON.
    pub fn to_bytes(&self) -> (Vec<u8>, Option<usize>) {
        let head = Head {
            model_name: &self.model_name,
            model_version: &self.model_version,
            id: self.id.as_deref(),
            parameters: &self.parameters,
            outputs: self.outputs.iter().map(|(tensor, binary)| Output::of(tensor, *binary)).collect(),
        };
        let mut bytes =
            serde_json::to_vec(&head).unwrap_or_else(|_| unreachable!("an answer is plain numbers and strings"));
        let json = bytes.len();
        let binary = self.outputs.iter().filter(|(_, binary)| *binary).map(|(tensor, _)| tensor);
        bytes.reserve_exact(binary.clone().map(|tensor| tensor.values.len() * 4).sum());
        for tensor in binary {
            bytes.extend(tensor.values.iter().flat_map(|value| value.to_le_bytes()));
        }
        (bytes, self.outputs.iter().any(|(_, binary)| *binary).then_some(json))
    }
}

impl<'a> Output<'a> {
    fn of(tensor: &'a Tensor, binary: bool) -> Self {
        Self {
            name: &tensor.name,
            datatype: DATATYPE,
            shape: &tensor.shape,
            parameters: binary.then(|| json!({ "binary_data_size": tensor.values.len() * 4 })),
            data: (!binary).then_some(&tensor.values),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_follow_the_json_in_the_order_of_the_outputs() -> Result<(), serde_json::Error> {
        let tensor =
            |name: &str, values: &[f32]| Tensor { name: name.into(), shape: vec![values.len()], values: values.into() };
        let answer = Answer {
            model_name: "m".into(),
            model_version: "2".into(),
            id: None,
            parameters: Map::new(),
            outputs: vec![
                (tensor("x", &[1.0]), true),
                (tensor("y", &[0.1, f32::NAN]), false),
                (tensor("z", &[2.0]), true),
            ],
        };
        let (bytes, json) = answer.to_bytes();
        let json = json.unwrap_or_default();
        let expected = json!({ "model_name": "m", "model_version": "2", "outputs": [
            { "name": "x", "datatype": "FP32", "shape": [1], "parameters": { "binary_data_size": 4 } },
            { "name": "y", "datatype": "FP32", "shape": [2], "data": [0.1, null] },
            { "name": "z", "datatype": "FP32", "shape": [1], "parameters": { "binary_data_size": 4 } },
        ] });
        assert_eq!(serde_json::from_slice::<Value>(&bytes[..json])?, expected);
        assert_eq!(bytes[json..], [1.0f32.to_le_bytes(), 2.0f32.to_le_bytes()].concat());
        Ok(())
    }
}
