//! The request of `infer`, from a body's bytes.

use serde::Deserialize;
use serde_json::{Map, Value};
use thiserror::Error;

use super::few::{Few, Parameters};
use super::flat::Flat;
use super::{DATATYPE, Tensor};

/// What is asked of a model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InferRequest {
    /// The request's id, given back in the answer.
    pub id: Option<String>,
    /// Parameters that are the model's matter, the protocol's own left out.
    pub parameters: Map<String, Value>,
    /// The model's inputs.
    pub inputs: Vec<Tensor>,
    /// Outputs that are wanted, each with whether it comes as bytes after the JSON; `None` means all.
    pub outputs: Option<Vec<(String, bool)>>,
    /// Outputs come as bytes after the JSON unless they are asked for otherwise.
    pub binary_outputs: bool,
}

/// A body that is no request.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RequestError {
    /// The JSON does not parse.
    #[error("request: {0}")]
    Json(#[from] serde_json::Error),
    /// The header and the body disagree.
    #[error("header {} is {length}, but the body has {body} bytes", super::HEADER_LENGTH)]
    HeaderLength {
        /// Announced bytes of JSON.
        length: usize,
        /// Bytes of the body.
        body: usize,
    },
    /// Bytes after the JSON that belong to no input, or too few of them.
    #[error("inputs have {expected} bytes after the JSON, but there are {found}")]
    BinaryLength {
        /// Sum of the inputs' sizes.
        expected: u64,
        /// Bytes that there are.
        found: usize,
    },
    /// An input that contradicts itself or is none of ours.
    #[error("input `{name}`: {problem}")]
    Input {
        /// The input's name.
        name: String,
        /// What is wrong with it.
        problem: String,
    },
    /// Raw elements for other inputs than there are.
    #[error("there are {inputs} inputs, but raw_input_contents has {raw}")]
    RawContents {
        /// Inputs.
        inputs: usize,
        /// Inputs whose elements there are.
        raw: usize,
    },
    /// Something of the protocol that Realbeam does not have.
    #[error("{0} is not supported")]
    Unsupported(&'static str),
}

/// Parameters of the protocol and its extensions that mean nothing here.
const IGNORED: [&str; 6] =
    ["sequence_id", "sequence_start", "sequence_end", "priority", "timeout", "binary_data_output"];

/// Most inputs, and outputs, of a request.
const MAX_TENSORS: usize = 4096;

/// Most axes of a tensor.
const MAX_AXES: usize = 8;

#[derive(Deserialize)]
struct Head {
    id: Option<String>,
    #[serde(default)]
    parameters: Parameters,
    inputs: Few<Input, MAX_TENSORS>,
    outputs: Option<Few<Output, MAX_TENSORS>>,
}

#[derive(Deserialize)]
struct Input {
    name: String,
    shape: Few<i64, MAX_AXES>,
    datatype: String,
    #[serde(default)]
    parameters: InputParameters,
    data: Option<Flat>,
}

#[derive(Default, Deserialize)]
struct InputParameters {
    binary_data_size: Option<u64>,
    shared_memory_region: Option<String>,
}

#[derive(Deserialize)]
struct Output {
    name: String,
    #[serde(default)]
    parameters: OutputParameters,
}

#[derive(Default, Deserialize)]
struct OutputParameters {
    binary_data: Option<bool>,
    #[serde(default)]
    classification: u64,
    shared_memory_region: Option<String>,
}

impl InferRequest {
    /// Reads a body of which the first `header_length` bytes are JSON, all of it where the header is absent.
    pub fn parse(body: &[u8], header_length: Option<usize>) -> Result<Self, RequestError> {
        let length = header_length.unwrap_or(body.len());
        let too_long = RequestError::HeaderLength { length, body: body.len() };
        let (json, binary) = body.split_at_checked(length).ok_or(too_long)?;
        let head: Head = serde_json::from_slice(json)?;
        let (Few(inputs), Parameters(parameters)) = (head.inputs, head.parameters);
        let sizes = inputs.iter().map(|input| input.parameters.binary_data_size.unwrap_or_default());
        let expected = sizes.fold(0, u64::saturating_add);
        if expected != binary.len() as u64 {
            return Err(RequestError::BinaryLength { expected, found: binary.len() });
        }
        let binary_outputs = parameters.get("binary_data_output").and_then(Value::as_bool).unwrap_or_default();
        let outputs = head.outputs.map(|Few(outputs)| outputs.into_iter().map(|o| o.read(binary_outputs)).collect());
        let parameters = parameters.into_iter().filter(|(name, _)| is_models_matter(name));
        let mut rest = binary;
        Ok(Self {
            id: head.id,
            parameters: parameters.collect(),
            inputs: inputs.into_iter().map(|input| input.read(&mut rest)).collect::<Result<_, _>>()?,
            outputs: outputs.transpose()?,
            binary_outputs,
        })
    }
}

impl Input {
    /// The tensor; its bytes, if it has any, are taken from the front of `rest`.
    fn read(self, rest: &mut &[u8]) -> Result<Tensor, RequestError> {
        if self.parameters.shared_memory_region.is_some() {
            return Err(RequestError::Unsupported("shared memory"));
        }
        let values = match (self.data, self.parameters.binary_data_size) {
            (Some(_), Some(_)) => Err("has both `data` and `binary_data_size`".into()),
            (None, None) => Err("has neither `data` nor `binary_data_size`".into()),
            (Some(Flat(values)), None) => Ok(values),
            (None, Some(size)) => {
                let end = usize::try_from(size).ok().filter(|end| *end <= rest.len());
                let (own, others) = rest.split_at(end.unwrap_or(rest.len()));
                *rest = others;
                float32(own)
            }
        };
        let Few(shape) = self.shape;
        tensor(self.name, &self.datatype, &shape, values)
    }
}

/// The tensor of an input, if its elements are there and are as many as its shape says.
pub(super) fn tensor(
    name: String,
    datatype: &str,
    shape: &[i64],
    values: Result<Vec<f32>, String>,
) -> Result<Tensor, RequestError> {
    let fail = |name: &str, problem: String| RequestError::Input { name: name.into(), problem };
    if datatype != DATATYPE {
        return Err(fail(&name, format!("datatype is `{datatype}`, expected {DATATYPE}")));
    }
    let values = values.map_err(|problem| fail(&name, problem))?;
    let lengths: Option<Vec<usize>> = shape.iter().map(|length| usize::try_from(*length).ok()).collect();
    let elements = |lengths: &[usize]| lengths.iter().try_fold(1, |n: usize, length| n.checked_mul(*length));
    match lengths {
        Some(shape) if elements(&shape) == Some(values.len()) => Ok(Tensor { name, shape, values }),
        _ => Err(fail(&name, format!("shape is {shape:?}, but there are {} elements", values.len()))),
    }
}

/// False for parameters of the protocol that mean nothing here.
pub(super) fn is_models_matter(parameter: &str) -> bool {
    !IGNORED.contains(&parameter)
}

impl Output {
    fn read(self, binary_outputs: bool) -> Result<(String, bool), RequestError> {
        if self.parameters.classification > 0 {
            return Err(RequestError::Unsupported("classification"));
        }
        if self.parameters.shared_memory_region.is_some() {
            return Err(RequestError::Unsupported("shared memory"));
        }
        Ok((self.name, self.parameters.binary_data.unwrap_or(binary_outputs)))
    }
}

/// Numbers from their little-endian bytes.
pub(super) fn float32(bytes: &[u8]) -> Result<Vec<f32>, String> {
    let (numbers, rest) = bytes.as_chunks::<4>();
    if !rest.is_empty() {
        return Err(format!("{} bytes are no whole number of {DATATYPE}", bytes.len()));
    }
    Ok(numbers.iter().map(|number| f32::from_le_bytes(*number)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(json: &str, binary: &[u8]) -> String {
        let body = [json.as_bytes(), binary].concat();
        InferRequest::parse(&body, Some(json.len())).err().map(|error| error.to_string()).unwrap_or_default()
    }

    #[test]
    fn tensors_come_as_numbers_or_as_bytes_in_their_order() -> Result<(), RequestError> {
        let json = r#"{"id":"7","parameters":{"seed":3,"binary_data_output":true},"inputs":[
            {"name":"a","shape":[2],"datatype":"FP32","parameters":{"binary_data_size":8}},
            {"name":"b","shape":[1,2],"datatype":"FP32","data":[[0.5,-1]]},
            {"name":"c","shape":[1],"datatype":"FP32","parameters":{"binary_data_size":4}}],
            "outputs":[{"name":"x"},{"name":"y","parameters":{"binary_data":false}}]}"#;
        let binary: Vec<u8> = [1.0f32, 2.0, 3.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        let request = InferRequest::parse(&[json.as_bytes(), &binary].concat(), Some(json.len()))?;
        let values: Vec<_> = request.inputs.iter().map(|input| input.values.clone()).collect();
        assert_eq!(values, [vec![1.0, 2.0], vec![0.5, -1.0], vec![3.0]]);
        assert_eq!(request.outputs, Some(vec![("x".into(), true), ("y".into(), false)]));
        assert_eq!((request.id.as_deref(), request.parameters.len()), (Some("7"), 1));
        Ok(())
    }

    #[test]
    fn sizes_that_lie_are_refused_before_anything_is_made_of_them() {
        let input = |shape: &str, size: u64| {
            format!(
                r#"{{"inputs":[{{"name":"a","shape":{shape},"datatype":"FP32","parameters":{{"binary_data_size":{size}}}}}]}}"#
            )
        };
        assert_eq!(problem(&input("[1]", 4), &[0; 4]), "");
        assert!(problem(&input("[2]", 4), &[0; 4]).contains("shape is [2], but there are 1 elements"));
        assert!(problem(&input("[-1]", 4), &[0; 4]).contains("shape is [-1]"));
        assert!(problem(&input("[4294967296,4294967296,4294967296]", 4), &[0; 4]).contains("but there are 1 elements"));
        assert!(problem(&input("[1]", 8), &[0; 4]).contains("have 8 bytes after the JSON, but there are 4"));
        assert!(problem(&input("[1]", u64::MAX), &[0; 4]).contains("but there are 4"));
        assert!(problem(&input("[1]", 4), &[0; 8]).contains("have 4 bytes after the JSON, but there are 8"));
        assert!(problem(&input("[1]", 3), &[0; 3]).contains("3 bytes are no whole number of FP32"));
        let longer = InferRequest::parse(b"{}", Some(3)).err().map(|error| error.to_string());
        assert_eq!(longer.as_deref(), Some("header inference-header-content-length is 3, but the body has 2 bytes"));
        let deep = format!("{{\"inputs\":{}", "[".repeat(100_000));
        assert!(problem(&deep, &[]).starts_with("request: "));
        let text = r#"{"inputs":[{"name":"a","shape":[1],"datatype":"BYTES","data":[1]}]}"#;
        assert!(problem(text, &[]).contains("datatype is `BYTES`, expected FP32"));
    }
}
