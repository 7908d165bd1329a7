//! The error body of the service: one JSON object, and the list of codes with the HTTP status that each one travels with.

use serde::{Deserialize, Serialize};

/// What every answer that is not a success holds as `application/json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ErrorBody {
    /// What went wrong, for a person.
    pub error: String,
    /// What went wrong, for a program.
    pub code: ErrorCode,
    /// The `x-request-id` of the answer, under which the service's log has the details.
    pub request_id: String,
}

/// Kinds of errors; in JSON their `snake_case` names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum ErrorCode {
    /// A query parameter is unknown, given twice or not readable.
    BadQuery,
    /// A header is given twice or not readable.
    BadHeader,
    /// The body did not arrive in full.
    BadBody,
    /// The body did not arrive in time.
    BodyTooSlow,
    /// The body is not what its type says.
    MalformedScan,
    /// The body is no request of the Open Inference Protocol.
    MalformedTensors,
    /// The secret that the route asks for is missing or wrong.
    Unauthorized,
    /// No such route.
    RouteNotFound,
    /// No such model or version.
    ModelNotFound,
    /// The route exists, for another method.
    MethodNotAllowed,
    /// No type in `Accept` can be given.
    NotAcceptable,
    /// The body has more bytes than the service takes.
    BodyTooLarge,
    /// The scan has more points than the service takes.
    TooManyPoints,
    /// `Content-Type` is not one of the known formats.
    UnsupportedMediaType,
    /// `Content-Encoding` is not `identity`.
    UnsupportedEncoding,
    /// A well-formed scan that cannot be worked with.
    UnusableScan,
    /// Tensors that the model does not take.
    UnusableTensors,
    /// The scan has something that the format of the answer cannot hold.
    UnencodableAnswer,
    /// The model was not loaded, for something is wrong with it; what was served before still is.
    ModelRefused,
    /// A later scan of the same stream has taken the place of this one, which still waited.
    Superseded,
    /// More requests wait than the service lets wait; try again.
    Overloaded,
    /// More bytes are under way than the service has memory for; try again.
    TooManyBytes,
    /// More connections are open than the service lets; try again.
    TooManyConnections,
    /// The answer would come after the deadline of the request.
    DeadlineExceeded,
    /// The model cannot be loaded, or gave no usable answer.
    ModelFailed,
    /// The service's own fault.
    Internal,
    /// The service starts or stops.
    NotReady,
}

impl ErrorCode {
    /// The HTTP status that goes with the code.
    pub const fn status(self) -> u16 {
        match self {
            Self::BadQuery | Self::BadHeader | Self::BadBody | Self::MalformedScan | Self::MalformedTensors => 400,
            Self::Unauthorized => 401,
            Self::RouteNotFound | Self::ModelNotFound => 404,
            Self::MethodNotAllowed => 405,
            Self::NotAcceptable => 406,
            Self::BodyTooSlow => 408,
            Self::Superseded => 409,
            Self::BodyTooLarge | Self::TooManyPoints => 413,
            Self::UnsupportedMediaType | Self::UnsupportedEncoding => 415,
            Self::UnusableScan | Self::UnusableTensors | Self::UnencodableAnswer | Self::ModelRefused => 422,
            Self::Overloaded | Self::TooManyBytes => 429,
            Self::ModelFailed | Self::Internal => 500,
            Self::NotReady | Self::TooManyConnections => 503,
            Self::DeadlineExceeded => 504,
        }
    }

    /// The status of gRPC that goes with the code: its number and its name.
    pub const fn grpc_status(self) -> (u8, &'static str) {
        match self {
            Self::BadQuery
            | Self::BadHeader
            | Self::BadBody
            | Self::MalformedScan
            | Self::MalformedTensors
            | Self::NotAcceptable
            | Self::UnsupportedMediaType
            | Self::UnusableScan
            | Self::UnusableTensors
            | Self::UnencodableAnswer => (3, "INVALID_ARGUMENT"),
            Self::BodyTooSlow | Self::DeadlineExceeded => (4, "DEADLINE_EXCEEDED"),
            Self::ModelNotFound => (5, "NOT_FOUND"),
            Self::BodyTooLarge | Self::TooManyPoints | Self::Overloaded | Self::TooManyBytes => {
                (8, "RESOURCE_EXHAUSTED")
            }
            Self::ModelRefused => (9, "FAILED_PRECONDITION"),
            Self::Superseded => (10, "ABORTED"),
            Self::RouteNotFound | Self::MethodNotAllowed | Self::UnsupportedEncoding => (12, "UNIMPLEMENTED"),
            Self::ModelFailed | Self::Internal => (13, "INTERNAL"),
            Self::NotReady | Self::TooManyConnections => (14, "UNAVAILABLE"),
            Self::Unauthorized => (16, "UNAUTHENTICATED"),
        }
    }

    /// The code's name, as in JSON.
    pub fn name(self) -> String {
        serde_json::to_value(self).ok().and_then(|name| Some(name.as_str()?.to_owned())).unwrap_or_default()
    }

    /// True if the request was turned away for what the service can, or may, take now, not for what it asked.
    pub const fn is_rejection(self) -> bool {
        matches!(self.status(), 408 | 409 | 413 | 429 | 503 | 504)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_body_is_three_strings() -> Result<(), serde_json::Error> {
        let body = ErrorBody { error: "no".into(), code: ErrorCode::ModelNotFound, request_id: "7".into() };
        let json = r#"{"error":"no","code":"model_not_found","request_id":"7"}"#;
        assert_eq!(serde_json::to_string(&body)?, json);
        assert_eq!(ErrorCode::ModelNotFound.name(), "model_not_found");
        assert_eq!(serde_json::from_str::<ErrorBody>(json)?, body);
        Ok(())
    }
}
