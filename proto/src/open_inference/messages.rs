//! The request and the answer of `infer` as messages of gRPC.

use std::collections::HashMap;

use serde_json::{Map, Value};

use super::request::{float32, is_models_matter, tensor};
use super::{Answer, DATATYPE, InferRequest, RequestError};
use crate::grpc::Received;
use crate::grpc::inference::infer_parameter::ParameterChoice;
use crate::grpc::inference::model_infer_request::{InferInputTensor, InferRequestedOutputTensor};
use crate::grpc::inference::model_infer_response::InferOutputTensor;
use crate::grpc::inference::{InferParameter, InferTensorContents, ModelInferRequest, ModelInferResponse};

/// What a [`ModelInferRequest`] asks for, its tensors left out.
#[derive(Clone, PartialEq, prost::Message)]
pub struct InferHead {
    /// The model's name.
    #[prost(string, tag = "1")]
    pub model_name: String,
    /// Its version; empty for any.
    #[prost(string, tag = "2")]
    pub model_version: String,
    #[prost(map = "string, message", tag = "4")]
    parameters: HashMap<String, InferParameter>,
}

impl Received for InferHead {
    const PAYLOAD: &'static [&'static [u64]] = ModelInferRequest::PAYLOAD;
}

impl InferHead {
    /// A parameter that is a text.
    pub fn text(&self, name: &str) -> Option<&str> {
        match self.parameters.get(name)?.parameter_choice.as_ref()? {
            ParameterChoice::StringParam(text) => Some(text),
            _ => None,
        }
    }
}

impl TryFrom<ModelInferRequest> for InferRequest {
    type Error = RequestError;

    /// Outputs go as bytes where the inputs came so.
    fn try_from(message: ModelInferRequest) -> Result<Self, RequestError> {
        let (inputs, raw) = (message.inputs.len(), message.raw_input_contents.len());
        let binary_outputs = raw > 0;
        if binary_outputs && raw != inputs {
            return Err(RequestError::RawContents { inputs, raw });
        }
        let mut raw = message.raw_input_contents.into_iter();
        let read = |input: InferInputTensor| {
            refuse_shared_memory(&input.parameters)?;
            let values = match (raw.next(), input.contents) {
                (Some(_), Some(_)) => Err("has both `contents` and `raw_input_contents`".into()),
                (Some(bytes), None) => float32(&bytes),
                (None, contents) => Ok(contents.unwrap_or_default().fp32_contents),
            };
            tensor(input.name, &input.datatype, &input.shape, values)
        };
        let wanted = |output: InferRequestedOutputTensor| {
            refuse_shared_memory(&output.parameters)?;
            if output.parameters.contains_key("classification") {
                return Err(RequestError::Unsupported("classification"));
            }
            Ok((output.name, binary_outputs))
        };
        let inputs = message.inputs.into_iter().map(read).collect::<Result<_, _>>()?;
        let outputs: Vec<_> = message.outputs.into_iter().map(wanted).collect::<Result<_, _>>()?;
        let parameters = message.parameters.into_iter().filter(|(name, _)| is_models_matter(name));
        Ok(Self {
            id: (!message.id.is_empty()).then_some(message.id),
            parameters: parameters.map(|(name, parameter)| (name, value(parameter))).collect(),
            inputs,
            outputs: (!outputs.is_empty()).then_some(outputs),
            binary_outputs,
        })
    }
}

impl From<Answer> for ModelInferResponse {
    /// The elements go raw where one output goes as bytes, for a message has them all in one way.
    fn from(answer: Answer) -> Self {
        let is_raw = answer.outputs.iter().any(|(_, binary)| *binary);
        let mut message = Self {
            model_name: answer.model_name,
            model_version: answer.model_version,
            id: answer.id.unwrap_or_default(),
            parameters: parameters(answer.parameters),
            ..Self::default()
        };
        for (tensor, _) in answer.outputs {
            let mut output = InferOutputTensor {
                name: tensor.name,
                datatype: DATATYPE.into(),
                shape: tensor.shape.into_iter().map(|length| length as i64).collect(),
                ..InferOutputTensor::default()
            };
            if is_raw {
                let bytes: Vec<u8> = tensor.values.iter().flat_map(|value| value.to_le_bytes()).collect();
                message.raw_output_contents.push(bytes.into());
            } else {
                output.contents = Some(InferTensorContents { fp32_contents: tensor.values });
            }
            message.outputs.push(output);
        }
        message
    }
}

fn refuse_shared_memory(parameters: &HashMap<String, InferParameter>) -> Result<(), RequestError> {
    let shared = parameters.contains_key("shared_memory_region");
    if shared { Err(RequestError::Unsupported("shared memory")) } else { Ok(()) }
}

fn value(parameter: InferParameter) -> Value {
    match parameter.parameter_choice {
        None => Value::Null,
        Some(ParameterChoice::BoolParam(flag)) => flag.into(),
        Some(ParameterChoice::Int64Param(number)) => number.into(),
        Some(ParameterChoice::Uint64Param(number)) => number.into(),
        Some(ParameterChoice::DoubleParam(number)) => number.into(),
        Some(ParameterChoice::StringParam(text)) => text.into(),
    }
}

fn parameters(values: Map<String, Value>) -> HashMap<String, InferParameter> {
    let choice = |value: Value| match value {
        Value::Bool(flag) => ParameterChoice::BoolParam(flag),
        Value::String(text) => ParameterChoice::StringParam(text),
        value => match (value.as_i64(), value.as_u64()) {
            (Some(number), _) => ParameterChoice::Int64Param(number),
            (None, Some(number)) => ParameterChoice::Uint64Param(number),
            (None, None) => ParameterChoice::StringParam(value.to_string()),
        },
    };
    values.into_iter().map(|(name, value)| (name, InferParameter { parameter_choice: Some(choice(value)) })).collect()
}
