//! What is asked of a model of the protocol, however it came, and the answer.

use axum::body::Bytes;
use lidar::formats::Format;
use lidar::label::CarlaTags;
use proto::open_inference::{Answer, InferRequest, Tensor};
use proto::{ErrorCode, Form, Frame};
use serde_json::{Map, Value};

use super::super::error::ApiError;
use super::super::query::ScanQuery;
use super::super::terms::Terms;
use super::super::work::Output;
use super::named::{Named, POINTS};
use crate::config::RequestLimits;
use crate::generator::Chance;
use crate::pipeline::{Fit, Pipeline, ScanError, ScanJob};
use crate::stopwatch::{Stage, StageTimes, Stopwatch};
use crate::worker::Caller;

/// What is asked for, but for the tensors.
pub(in crate::http) struct Ask {
    pub(in crate::http) model: Named,
    pub(in crate::http) terms: Terms,
    /// What is said of a scan beside the request's parameters.
    pub(in crate::http) query: Vec<(String, String)>,
    /// Of a scan, the points of each ring.
    pub(in crate::http) ring_counts: Option<Vec<u32>>,
}

/// What a model is given.
pub(in crate::http) enum Given {
    Tensors(InferRequest),
    /// Points alone, as `x, y, z, intensity`, float32 each; they come back so too.
    Points(Bytes),
}

/// What a model gives; encoded by whoever has asked.
pub(in crate::http) struct Inferred<A> {
    pub(in crate::http) answer: A,
    pub(in crate::http) times: StageTimes,
    /// Of a scan, how it fitted the model.
    fit: Option<Fit>,
}

impl<A: Send + 'static> Output for Inferred<A> {
    fn times(&mut self) -> &mut StageTimes {
        &mut self.times
    }

    fn fit(&self) -> Option<&Fit> {
        self.fit.as_ref()
    }
}

impl<A> Inferred<A> {
    /// The answer in another form, with the time that this takes.
    pub(in crate::http) fn encode<B>(self, encode: impl FnOnce(A) -> B) -> Inferred<B> {
        let mut watch = Stopwatch::start();
        let answer = encode(self.answer);
        watch.lap(Stage::Encode);
        let Self { mut times, fit, .. } = self;
        times.set(Stage::Encode, times.of(Stage::Encode) + watch.times().of(Stage::Encode));
        Inferred { answer, times, fit }
    }
}

impl Ask {
    /// Runs the model; `watch` has begun when reading the tensors did.
    pub(in crate::http) fn run(
        &self,
        given: Given,
        watch: Stopwatch,
        limits: &RequestLimits,
        (pipeline, caller): (&mut Pipeline, Caller<'_>),
    ) -> Result<Inferred<Answer>, ApiError> {
        if self.model.is_pipeline {
            self.scan(given, watch, limits, (pipeline, caller))
        } else {
            self.generate(given, watch, limits.max_batch, (pipeline, caller))
        }
    }

    /// The whole pipeline.
    fn scan(
        &self,
        given: Given,
        mut watch: Stopwatch,
        limits: &RequestLimits,
        (pipeline, caller): (&mut Pipeline, Caller<'_>),
    ) -> Result<Inferred<Answer>, ApiError> {
        let (request, points) = match given {
            Given::Points(points) => (InferRequest { binary_outputs: true, ..InferRequest::default() }, points),
            Given::Tensors(mut request) => {
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
            limits: limits.formats(CarlaTags::Since0914),
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
        let answer = self.answer(request.id, vec![(points, binary)], parameters);
        Ok(Inferred { answer, times, fit: Some(scan.fit) })
    }

    /// The generator alone.
    fn generate(
        &self,
        given: Given,
        mut watch: Stopwatch,
        max_batch: usize,
        (pipeline, caller): (&mut Pipeline, Caller<'_>),
    ) -> Result<Inferred<Answer>, ApiError> {
        let Given::Tensors(request) = given else {
            let message = format!(
                "model `{}` has several inputs or axes; only `scan` takes a body without JSON",
                self.model.name
            );
            return Err(ApiError::new(ErrorCode::MalformedTensors, message));
        };
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
        Ok(Inferred { answer: self.answer(request.id, tensors, Map::new()), times: watch.times(), fit: None })
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

    fn answer(&self, id: Option<String>, outputs: Vec<(Tensor, bool)>, parameters: Map<String, Value>) -> Answer {
        Answer {
            model_name: self.model.name.clone(),
            model_version: self.model.offer.version.to_string(),
            id,
            parameters,
            outputs,
        }
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
