//! `POST /v2/models/{model}/infer`: tensors in, tensors out.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::{Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use lidar::formats::{Format, Limits};
use lidar::label::CarlaTags;
use proto::open_inference::{Answer, HEADER_LENGTH, InferRequest, Tensor};
use proto::{ErrorCode, Form, Frame};
use serde_json::{Map, Value};

use super::super::error::ApiError;
use super::super::query::{self, ScanQuery};
use super::super::terms::{self, Terms};
use super::super::work::Output;
use super::super::{App, answer, body, ring_counts};
use super::named::{InPath, Named, POINTS};
use crate::generator::Chance;
use crate::pipeline::{Fit, Pipeline, ScanError, ScanJob};
use crate::stopwatch::{Stage, StageTimes, Stopwatch};
use crate::worker::Caller;

/// Everything that is known before the body has come.
struct Wish {
    model: Named,
    terms: Terms,
    query: Vec<(String, String)>,
    header_length: Option<usize>,
    /// Of a scan, the points of each ring.
    ring_counts: Option<Vec<u32>>,
}

/// An answer's bytes, and how many of them are JSON where tensors follow.
struct Encoded {
    bytes: Vec<u8>,
    header_length: Option<usize>,
    times: StageTimes,
    /// Of a scan, how it fitted the model.
    fit: Option<Fit>,
}

impl Output for Encoded {
    fn times(&mut self) -> &mut StageTimes {
        &mut self.times
    }

    fn fit(&self) -> Option<&Fit> {
        self.fit.as_ref()
    }
}

/// The handler.
pub(super) async fn infer(State(app): State<Arc<App>>, path: InPath, request: Request) -> Result<Response, ApiError> {
    let (head, body) = request.into_parts();
    let admitted = Wish::read(&app, path, &head).and_then(|wish| {
        let admitted = body::admit(&app, &head.headers, &wish.model.offer)?;
        Ok((wish, admitted))
    });
    let (wish, admitted) = match admitted {
        Ok(admitted) => admitted,
        Err(error) => {
            body::discard(body).await;
            return Err(error);
        }
    };
    let (bytes, share) = admitted.read(&app, &wish.terms, body).await?;
    let (offer, terms) = (Arc::clone(&wish.model.offer), wish.terms.clone());
    let max_points = app.limits.max_points;
    let max_batch = app.limits.max_batch;
    let work = move |pipeline: &mut Pipeline, caller: Caller<'_>| {
        if wish.model.is_pipeline {
            wish.scan(pipeline, &bytes, max_points, caller)
        } else {
            wish.generate(pipeline, &bytes, max_batch, caller)
        }
    };
    let encoded = app.work(&offer, &terms, work).await?;
    let mut response = answer::on_its_way(encoded.bytes, share).into_response();
    let headers = response.headers_mut();
    let content_type = if encoded.header_length.is_some() { "application/octet-stream" } else { "application/json" };
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(content_type));
    if let Some(length) = encoded.header_length {
        headers.insert(HeaderName::from_static(HEADER_LENGTH), length.into());
    }
    Ok(response)
}

impl Wish {
    fn read(app: &App, path: InPath, head: &Parts) -> Result<Self, ApiError> {
        let (query, headers) = (query::pairs(&head.uri)?, &head.headers);
        let generator = query.iter().find(|(key, _)| key == "model").map(|(_, name)| &**name);
        let terms = Terms::read(headers)?;
        let model = path.find_for(app, generator, terms.canary_key(&head.extensions))?;
        let ring_counts = if model.is_pipeline { ring_counts::read(headers, &model.offer)? } else { None };
        Ok(Self { terms, header_length: terms::number(headers, HEADER_LENGTH)?, ring_counts, model, query })
    }

    /// The whole pipeline. A body without JSON is the points, and comes back as points alone but for the JSON that names them.
    fn scan(
        &self,
        pipeline: &mut Pipeline,
        body: &Bytes,
        max_points: usize,
        caller: Caller<'_>,
    ) -> Result<Encoded, ApiError> {
        let mut watch = Stopwatch::start();
        let (request, points) = match self.header_length {
            Some(0) => (InferRequest { binary_outputs: true, ..InferRequest::default() }, body.clone()),
            length => {
                let mut request = InferRequest::parse(body, length)?;
                let points = points_of(&mut request)?;
                (request, points)
            }
        };
        let binary = wanted(&request, &[POINTS])?.contains(&(POINTS, true));
        let query = self.query_with(&request.parameters)?;
        let seed = self.terms.seed_with(query.seed)?;
        let job = ScanJob {
            bytes: points,
            format: Format::Kitti,
            answer: Form::Scan(Format::Kitti),
            frame: query.frame.unwrap_or(Frame::Ros),
            ring_counts: self.ring_counts.clone(),
            chance: Chance { seed, noise: query.noise },
            limits: Limits { max_points, carla_tags: CarlaTags::Since0914 },
        };
        watch.lap(Stage::Decode);
        let scan = pipeline.run(&job, caller)?;
        let mut times = scan.times;
        times.set(Stage::Decode, times.of(Stage::Decode) + watch.times().of(Stage::Decode));
        let values = floats(&scan.bytes);
        let points = Tensor { name: POINTS.into(), shape: vec![values.len() / 4, 4], values };
        let model = &self.model.offer.model.name;
        let parameters = [("model", Value::from(model.clone())), ("seed", seed.into())];
        let parameters = parameters.map(|(name, value)| (name.to_owned(), value)).into_iter().collect();
        let encoded = self.encode(request.id, vec![(points, binary)], parameters, times);
        Ok(Encoded { fit: Some(scan.fit), ..encoded })
    }

    /// The generator alone.
    fn generate(
        &self,
        pipeline: &mut Pipeline,
        body: &[u8],
        max_batch: usize,
        caller: Caller<'_>,
    ) -> Result<Encoded, ApiError> {
        let mut watch = Stopwatch::start();
        if self.header_length == Some(0) {
            let message = format!(
                "model `{}` has several inputs or axes; only `scan` takes a body without JSON",
                self.model.name
            );
            return Err(ApiError::new(ErrorCode::MalformedTensors, message));
        }
        let request = InferRequest::parse(body, self.header_length)?;
        let names: Vec<&str> = self.model.offer.model.outputs.iter().map(|output| &*output.name).collect();
        let wanted = wanted(&request, &names)?;
        watch.lap(Stage::Decode);
        if caller.has_left() {
            return Err(ScanError::Abandoned.into());
        }
        let mut outputs = pipeline.generate(&request.inputs, max_batch)?;
        watch.lap(Stage::Infer);
        let tensors = wanted.iter().filter_map(|(name, binary)| {
            let place = outputs.iter().position(|output| output.name == *name)?;
            Some((outputs.swap_remove(place), *binary))
        });
        let tensors = tensors.collect();
        Ok(self.encode(request.id, tensors, Map::new(), watch.times()))
    }

    /// What the query and the request's parameters say together.
    fn query_with(&self, parameters: &Map<String, Value>) -> Result<ScanQuery, ApiError> {
        let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), Into::into);
        let named = parameters.iter().map(|(name, value)| (name.clone(), text(value)));
        let pairs: Vec<_> = self.query.iter().cloned().chain(named).collect();
        let query = ScanQuery::parse(&pairs)?;
        if parameters.contains_key("model") || query.version.is_some() || query.tags.is_some() {
            let message =
                "`model` belongs into the query, `version` into the path, and `tags` are CARLA's semantic lidar's";
            return Err(ApiError::new(ErrorCode::BadQuery, message));
        }
        Ok(query)
    }

    fn encode(
        &self,
        id: Option<String>,
        outputs: Vec<(Tensor, bool)>,
        parameters: Map<String, Value>,
        mut times: StageTimes,
    ) -> Encoded {
        let mut watch = Stopwatch::start();
        let answer = Answer {
            model_name: self.model.name.clone(),
            model_version: self.model.offer.version.to_string(),
            id,
            parameters,
            outputs,
        };
        let (bytes, header_length) = answer.to_bytes();
        watch.lap(Stage::Encode);
        times.set(Stage::Encode, times.of(Stage::Encode) + watch.times().of(Stage::Encode));
        Encoded { bytes, header_length, times, fit: None }
    }
}

/// The names of the outputs that are wanted, each with whether it goes as bytes; in the request's order, or all.
fn wanted<'n>(request: &InferRequest, names: &[&'n str]) -> Result<Vec<(&'n str, bool)>, ApiError> {
    let Some(outputs) = &request.outputs else {
        return Ok(names.iter().map(|name| (*name, request.binary_outputs)).collect());
    };
    if (1..outputs.len()).any(|i| outputs[..i].iter().any(|(earlier, _)| *earlier == outputs[i].0)) {
        return Err(ApiError::new(ErrorCode::UnusableTensors, "an output is asked for twice"));
    }
    let find = |(wanted, binary): &(String, bool)| {
        let name = names.iter().find(|name| *name == wanted);
        let unknown = || format!("no output `{wanted}`; there are {}", names.join(", "));
        name.map(|name| (*name, *binary)).ok_or_else(|| ApiError::new(ErrorCode::UnusableTensors, unknown()))
    };
    outputs.iter().map(find).collect()
}

/// The bytes of the pipeline's one input.
fn points_of(request: &mut InferRequest) -> Result<Bytes, ApiError> {
    let inputs = std::mem::take(&mut request.inputs);
    match &inputs[..] {
        [points] if points.name == POINTS && points.shape.len() == 2 && points.shape[1] == 4 => {
            Ok(points.values.iter().flat_map(|value| value.to_le_bytes()).collect())
        }
        inputs => {
            let found: Vec<_> = inputs.iter().map(|input| format!("{} {:?}", input.name, input.shape)).collect();
            let message = format!("inputs are `{}`, expected {POINTS} [-1, 4]", found.join("; "));
            Err(ApiError::new(ErrorCode::UnusableTensors, message))
        }
    }
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|number| f32::from_le_bytes(*number)).collect()
}
