//! Errors on their way to the client.

use axum::response::{IntoResponse, Response};
use lidar::formats::FormatError;
use lidar::projection::ProjectionError;
use proto::ErrorCode;
use proto::grpc::MessageError;
use proto::open_inference::RequestError;

use crate::catalogue::CatalogueError;
use crate::pipeline::ScanError;
use crate::repository::RepositoryError;
use crate::tensors::TensorError;
use crate::worker::PoolError;

/// What a handler answers when it cannot do what was asked. [`envelope`](super::envelope) gives it the request's id and its JSON.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ApiError {
    pub(crate) code: ErrorCode,
    /// What the client is told.
    pub(crate) message: String,
    /// What the log is told besides.
    pub(crate) detail: Option<String>,
}

impl ApiError {
    /// An error that the client may know all about.
    pub(crate) fn new(code: ErrorCode, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), detail: None }
    }

    /// An error of our own: paths, versions and libraries' words stay in the log.
    pub(crate) fn hidden(code: ErrorCode, detail: &impl ToString) -> Self {
        let message = match code {
            ErrorCode::ModelFailed => "the model failed; the service's log has the details under this request_id",
            _ => "internal error; the service's log has the details under this request_id",
        };
        Self { code, message: message.into(), detail: Some(detail.to_string()) }
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let status = axum::http::StatusCode::from_u16(self.code.status());
        let mut response = status.unwrap_or(axum::http::StatusCode::INTERNAL_SERVER_ERROR).into_response();
        response.extensions_mut().insert(self);
        response
    }
}

impl From<ScanError> for ApiError {
    fn from(error: ScanError) -> Self {
        let message = error.to_string();
        match &error {
            ScanError::Decode(format) => Self::new(decode_code(format), message),
            ScanError::Project(ProjectionError::TooManyPoints(_)) | ScanError::TooManyToList { .. } => {
                Self::new(ErrorCode::TooManyPoints, message)
            }
            ScanError::Project(_) => Self::new(ErrorCode::UnusableScan, message),
            ScanError::Infer(_) => Self::hidden(ErrorCode::ModelFailed, &message),
            ScanError::NotANumber(_) => Self::new(ErrorCode::ModelFailed, message),
            ScanError::Draw(_) => Self::hidden(ErrorCode::Internal, &message),
            // Nobody is there to read this.
            ScanError::Abandoned => Self::new(ErrorCode::DeadlineExceeded, message),
            ScanError::Encode(_) => Self::new(ErrorCode::UnencodableAnswer, message),
        }
    }
}

fn decode_code(error: &FormatError) -> ErrorCode {
    match error {
        FormatError::TooMany { .. } => ErrorCode::TooManyPoints,
        FormatError::Missing { .. } | FormatError::Unsupported { .. } | FormatError::FarFromOrigin { .. } => {
            ErrorCode::UnusableScan
        }
        _ => ErrorCode::MalformedScan,
    }
}

impl From<MessageError> for ApiError {
    fn from(error: MessageError) -> Self {
        Self::new(ErrorCode::MalformedTensors, error.to_string())
    }
}

impl From<RequestError> for ApiError {
    fn from(error: RequestError) -> Self {
        Self::new(ErrorCode::MalformedTensors, error.to_string())
    }
}

impl From<TensorError> for ApiError {
    fn from(error: TensorError) -> Self {
        match error {
            TensorError::Inputs { .. } => Self::new(ErrorCode::UnusableTensors, error.to_string()),
            TensorError::Infer(_) => Self::hidden(ErrorCode::ModelFailed, &error),
        }
    }
}

impl From<PoolError> for ApiError {
    fn from(error: PoolError) -> Self {
        match error {
            PoolError::Full => Self::new(ErrorCode::Overloaded, "too many scans wait already; try again later"),
            PoolError::Panicked | PoolError::NotRebuilt => Self::hidden(ErrorCode::Internal, &error),
            PoolError::Ended => Self::new(ErrorCode::NotReady, "the service is stopping"),
        }
    }
}

impl From<RepositoryError> for ApiError {
    fn from(error: RepositoryError) -> Self {
        match error {
            RepositoryError::UnknownName { .. } | RepositoryError::UnknownVersion { .. } => {
                Self::new(ErrorCode::ModelNotFound, error.to_string())
            }
            RepositoryError::Io { .. } => Self::hidden(ErrorCode::Internal, &error),
            RepositoryError::Model(_) => Self::hidden(ErrorCode::ModelFailed, &error),
        }
    }
}

impl From<CatalogueError> for ApiError {
    fn from(error: CatalogueError) -> Self {
        match error {
            CatalogueError::Repository(error) => error.into(),
            error => Self::hidden(ErrorCode::ModelFailed, &error),
        }
    }
}
