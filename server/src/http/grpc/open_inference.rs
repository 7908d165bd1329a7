//! `inference.GRPCInferenceService`: the Open Inference Protocol.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::response::Response;
use proto::ErrorCode;
use proto::grpc::inference::model_metadata_response::TensorMetadata;
use proto::grpc::inference::{
    ModelInferRequest, ModelInferResponse, ModelMetadataRequest, ModelMetadataResponse, ModelReadyRequest,
    ModelReadyResponse, ServerLiveRequest, ServerLiveResponse, ServerMetadataRequest, ServerMetadataResponse,
    ServerReadyRequest, ServerReadyResponse,
};
use proto::grpc::{Received, decode};
use proto::open_inference::{InferHead, InferRequest};

use super::super::error::ApiError;
use super::super::open_inference::{Ask, Given, InPath, Metadata, SERVER, is_ready};
use super::super::terms::Terms;
use super::super::{App, answer, ring_counts};
use super::messages::call;
use super::reply;
use crate::pipeline::Pipeline;
use crate::stopwatch::Stopwatch;
use crate::worker::Caller;

/// `ServerLive`: the process answers.
pub(super) async fn server_live(State(app): State<Arc<App>>, request: Request) -> Result<Response, ApiError> {
    describe(&app, request, |_: ServerLiveRequest| Ok(ServerLiveResponse { live: true })).await
}

/// `ServerReady`: scans are taken.
pub(super) async fn server_ready(State(app): State<Arc<App>>, request: Request) -> Result<Response, ApiError> {
    describe(&app, request, |_: ServerReadyRequest| Ok(ServerReadyResponse { ready: app.is_ready() })).await
}

/// `ModelReady`: the model takes scans.
pub(super) async fn model_ready(State(app): State<Arc<App>>, request: Request) -> Result<Response, ApiError> {
    let answer = |asked: ModelReadyRequest| {
        let ready = named(asked.name, &asked.version).is_ok_and(|model| is_ready(&app, model));
        Ok(ModelReadyResponse { ready })
    };
    describe(&app, request, answer).await
}

/// `ServerMetadata`: name and version.
pub(super) async fn server_metadata(State(app): State<Arc<App>>, request: Request) -> Result<Response, ApiError> {
    let (name, version) = SERVER;
    let metadata = ServerMetadataResponse { name: name.into(), version: version.into(), extensions: Vec::new() };
    describe(&app, request, |_: ServerMetadataRequest| Ok(metadata)).await
}

/// `ModelMetadata`: versions, inputs and outputs.
pub(super) async fn model_metadata(State(app): State<Arc<App>>, request: Request) -> Result<Response, ApiError> {
    let answer = |asked: ModelMetadataRequest| {
        let Metadata { name, versions, platform, inputs, outputs } =
            Metadata::of(&app, named(asked.name, &asked.version)?.find(&app)?);
        let [inputs, outputs] = [inputs, outputs].map(|tensors| {
            let tensor = tensors.into_iter().map(|tensor| TensorMetadata {
                name: tensor.name,
                datatype: tensor.datatype.into(),
                shape: tensor.shape,
            });
            tensor.collect()
        });
        Ok(ModelMetadataResponse { name, versions, platform: platform.into(), inputs, outputs })
    };
    describe(&app, request, answer).await
}

/// `ModelInfer`: tensors in, tensors out.
pub(super) async fn model_infer(State(app): State<Arc<App>>, request: Request) -> Result<Response, ApiError> {
    let (head, messages) = call(request).await?;
    let terms = Terms::read(&head.headers)?;
    let (message, share) = messages.only(&app, &terms).await?;
    // Which workers the tensors are for; reading them is theirs.
    let asked: InferHead = decode(message.clone())?;
    let generator = asked.text("model");
    let model = named(asked.model_name.clone(), &asked.model_version)?;
    let model = model.find_for(&app, generator, terms.canary_key(&head.extensions))?;
    let ring_counts = if model.is_pipeline { ring_counts::read(&head.headers, &model.offer)? } else { None };
    let is_named = model.is_pipeline && generator.is_some();
    let (offer, limits) = (Arc::clone(&model.offer), app.limits);
    let entered = terms.enter(&app.streams);
    let ask = Ask { model, terms: terms.clone(), query: Vec::new(), ring_counts };
    let work = move |pipeline: &mut Pipeline, caller: Caller<'_>| {
        let watch = Stopwatch::start();
        let mut request = InferRequest::try_from(decode::<ModelInferRequest>(message)?)?;
        if is_named {
            request.parameters.remove("model");
        }
        let inferred = ask.run(Given::Tensors(request), watch, &limits, (pipeline, caller))?;
        Ok(inferred.encode(|answer| reply::framed(&ModelInferResponse::from(answer))))
    };
    let inferred = app.work(&offer, &terms, entered, work).await?;
    let mut response = reply::one(answer::on_its_way(inferred.answer, share));
    response.extensions_mut().insert(inferred.times);
    Ok(response)
}

/// Answers a call whose answer is at hand.
async fn describe<Q: Received, A: prost::Message>(
    app: &App,
    request: Request,
    answer: impl FnOnce(Q) -> Result<A, ApiError>,
) -> Result<Response, ApiError> {
    let (head, messages) = call(request).await?;
    let (message, _share) = messages.only(app, &Terms::read(&head.headers)?).await?;
    Ok(reply::one(reply::framed(&answer(decode(message)?)?).into()))
}

fn named(name: String, version: &str) -> Result<InPath, ApiError> {
    if name.is_empty() {
        return Err(ApiError::new(ErrorCode::ModelNotFound, "no model is named"));
    }
    InPath::new(name, Some(version).filter(|version| !version.is_empty()))
}
