//! `realbeam.v1.Scans/Scan`: scans as a simulator makes them, and an answer to each.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::{Request, State};
use axum::response::Response;
use hyper::body::Frame;
use proto::ErrorCode;
use proto::grpc::decode;
use proto::grpc::scans::{Failure, Mode, ScanRequest, ScanResponse};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio::time::Instant;
use tokio_util::task::AbortOnDropHandle;

use super::super::envelope::RequestId;
use super::super::error::ApiError;
use super::super::query::ScanQuery;
use super::super::scan::{Wish, negotiated};
use super::super::terms::{self, Terms};
use super::super::{App, answer, body, ring_counts};
use super::messages::{Messages, call};
use super::reply::{self, Frames};
use crate::budget::Share;
use crate::pipeline::ScanAnswer;
use crate::streams::{Place, Streams, Superseded};

/// The method's route.
pub(super) const ROUTE: &str = "/realbeam.v1.Scans/Scan";

/// In the metrics, the route of each scan of a stream; the stream itself counts under its own.
const ROUTE_OF_A_SCAN: &str = "/realbeam.v1.Scans/Scan/scan";

/// Scans of a stream that may be under way: read, made realistic, or on their way back; fewer where fewer may wait for the workers.
const MAX_UNDER_WAY: usize = 8;

/// Answers that may wait for those before them; beyond those under way they are words about scans that were given up.
const MAX_ANSWERS: usize = 64;

/// Field of an answer that holds the realistic scan.
const DATA: u8 = 3;

/// A stream of scans.
struct Stream {
    app: Arc<App>,
    request_id: String,
    /// Whose canary the stream is.
    canary_key: Option<String>,
    /// Of the whole call.
    terms: Terms,
    /// Its one scan that waits and may be given up.
    latest: Arc<Streams>,
    places: Arc<Semaphore>,
    max_under_way: usize,
}

/// A scan that has been read.
struct Received {
    request: ScanRequest,
    share: Share,
    under_way: OwnedSemaphorePermit,
}

/// What the answer to a scan is made of, in pieces; the scan is under way until they have left.
struct Answered {
    pieces: Vec<Bytes>,
    _under_way: Option<OwnedSemaphorePermit>,
}

/// A scan whose answer is being made; nobody makes it once this is dropped.
struct UnderWay {
    number: u64,
    answering: AbortOnDropHandle<Answered>,
}

/// The handler.
pub(super) async fn scan(State(app): State<Arc<App>>, request: Request) -> Result<Response, ApiError> {
    let (head, messages) = call(request).await?;
    let terms = Terms::read(&head.headers)?;
    let max_under_way = MAX_UNDER_WAY.min(app.catalogue.options().queue).max(1);
    let stream = Arc::new(Stream {
        app,
        request_id: head.extensions.get().map(|RequestId(id)| id.clone()).unwrap_or_default(),
        canary_key: terms.canary_key(&head.extensions).map(Into::into),
        terms,
        latest: Arc::default(),
        places: Arc::new(Semaphore::new(max_under_way)),
        max_under_way,
    });
    let (frames, response) = reply::streaming();
    tokio::spawn(async move {
        tokio::select! {
            () = stream.serve(messages, &frames) => {}
            // The client has gone.
            () = frames.closed() => {}
        }
    });
    Ok(response)
}

impl Stream {
    /// Reads and answers at the same time, until the client has said all and heard all.
    async fn serve(self: &Arc<Self>, messages: Messages, frames: &Frames) {
        let (answers, made) = mpsc::channel(MAX_ANSWERS);
        let both = async {
            let (ended, ()) = tokio::join!(self.read(messages, answers), self.answer_in_order(made, frames));
            ended
        };
        let ended = tokio::select! {
            ended = both => ended,
            () = terms::until(self.terms.deadline) => Err(terms::too_late()),
        };
        if let Err(error) = &ended {
            self.app.failed(error, &self.request_id);
        }
        // The client may have gone.
        let _ = frames.send(Frame::trailers(reply::trailers(ended.as_ref().err()))).await;
    }

    /// Reads scans and has them answered, until the last one, an error, or the service's end.
    async fn read(self: &Arc<Self>, mut messages: Messages, answers: mpsc::Sender<UnderWay>) -> Result<(), ApiError> {
        loop {
            let received = tokio::select! {
                () = self.app.end.cancelled() => {
                    return Err(ApiError::new(ErrorCode::NotReady, "the service is stopping"));
                }
                received = self.next(&mut messages) => received?,
            };
            let Some(Received { request, share, under_way }) = received else { return Ok(()) };
            let number = request.number;
            // A scan takes its place before the next one is read.
            let wish = self.wish(&request).map(|wish| {
                let entered = wish.terms.enter(&self.latest);
                (wish, entered)
            });
            let stream = Arc::clone(self);
            let answering = tokio::spawn(async move {
                let started = Instant::now();
                let made = match wish {
                    Ok((wish, entered)) => stream.realistic(&wish, entered, request, share).await,
                    Err(error) => Err(error),
                };
                let status = reply::status(made.as_ref().err()).1;
                stream.app.metrics.answered(ROUTE_OF_A_SCAN, status, started.elapsed());
                match made {
                    Ok(pieces) => Answered { pieces, _under_way: Some(under_way) },
                    Err(error) => stream.failure(number, &error),
                }
            });
            let under_way = UnderWay { number, answering: AbortOnDropHandle::new(answering) };
            if answers.send(under_way).await.is_err() {
                return Ok(());
            }
        }
    }

    /// The next scan, once there is room for it; `None` after the last.
    async fn next(&self, messages: &mut Messages) -> Result<Option<Received>, ApiError> {
        let (limits, idle_time) = (&self.app.limits, self.app.idle_time);
        let length = {
            let mut announced = std::pin::pin!(messages.announced(limits.max_body_bytes));
            loop {
                match tokio::time::timeout(idle_time, announced.as_mut()).await {
                    Ok(length) => break length?,
                    Err(_) if self.places.available_permits() < self.max_under_way => {}
                    Err(_) => {
                        let message = format!("no scan has come for {} s", idle_time.as_secs_f64());
                        return Err(ApiError::new(ErrorCode::BodyTooSlow, message));
                    }
                }
            }
        };
        let Some(length) = length else { return Ok(None) };
        let place = Arc::clone(&self.places).acquire_owned().await;
        let under_way = place.map_err(|error| ApiError::hidden(ErrorCode::Internal, &error))?;
        let share = self.app.budget.wait_for(length).await;
        let message = body::in_time(limits.body_time, &self.terms, messages.message(length)).await?;
        Ok(Some(Received { request: decode(message)?, share, under_way }))
    }

    /// What a scan asks for. Its fields are read as the query and the headers of `POST /v1/scan` are.
    fn wish(&self, request: &ScanRequest) -> Result<Wish, ApiError> {
        let texts =
            [("model", &request.model), ("noise", &request.noise), ("frame", &request.frame), ("tags", &request.tags)];
        let pairs = texts.into_iter().filter(|(_, text)| !text.is_empty());
        let query = ScanQuery::parse(&pairs.map(|(key, text)| (key.into(), text.clone())).collect::<Vec<_>>())?;
        let deadline = (request.deadline_ms > 0).then(|| terms::deadline("deadline_ms", request.deadline_ms));
        let latest_only = match Mode::try_from(request.mode) {
            Ok(mode) => mode == Mode::Latest,
            Err(error) => return Err(ApiError::new(ErrorCode::BadQuery, format!("mode: {error}"))),
        };
        let stream = latest_only.then(String::new);
        let terms = Terms { deadline: deadline.transpose()?, stream, latest_only, seed: None };
        let content = Some(&*request.content_type).filter(|content| !content.is_empty());
        let (content, accepted) = negotiated(content, &request.accept)?;
        let offer = self.app.catalogue.find(query.model.as_deref(), request.version, self.canary_key.as_deref())?;
        let counts = &request.ring_counts;
        if !counts.is_empty() {
            ring_counts::check("ring_counts", counts.len(), &offer)?;
        }
        let ring_counts = (!counts.is_empty()).then(|| counts.clone());
        Ok(Wish { query, terms, seed: request.seed, content, accepted, ring_counts, offer })
    }

    /// Makes a scan realistic.
    async fn realistic(
        &self,
        wish: &Wish,
        entered: (Option<Place>, Option<Superseded>),
        request: ScanRequest,
        share: Share,
    ) -> Result<Vec<Bytes>, ApiError> {
        let ScanAnswer { bytes, fit, times } = self.app.scan(wish, entered, request.data).await?;
        let response = ScanResponse {
            number: request.number,
            content_type: wish.accepted.name.into(),
            seed: wish.seed,
            model: wish.offer.model.name.clone(),
            model_version: wish.offer.version,
            model_digest: format!("sha256:{}", wish.offer.model.digest),
            points_in: fit.report.points_in as u64,
            points_kept: fit.kept as u64,
            points_dropped: fit.dropped() as u64,
            points_lost: fit.report.lost as u64,
            points_invalid: fit.invalid() as u64,
            points_out_of_range: fit.out_of_range() as u64,
            points_added: fit.added as u64,
            grid_coverage: fit.coverage.rings,
            warning: fit.warning.unwrap_or_default(),
            timing: times.to_string(),
            ..ScanResponse::default()
        };
        Ok(reply::framed_with(&response, DATA, answer::on_its_way(bytes, share)).into())
    }

    /// The answer that says what went wrong with a scan.
    fn failure(&self, number: u64, error: &ApiError) -> Answered {
        self.app.failed(error, &self.request_id);
        let (code, status) = (error.code.name(), i32::from(error.code.grpc_status().0));
        let failure = Some(Failure { code, status, message: error.message.clone() });
        let response = ScanResponse { number, failure, ..ScanResponse::default() };
        Answered { pieces: vec![reply::framed(&response).into()], _under_way: None }
    }

    /// Sends the answers in the order of their scans.
    async fn answer_in_order(&self, mut answers: mpsc::Receiver<UnderWay>, frames: &Frames) {
        while let Some(UnderWay { number, answering }) = answers.recv().await {
            let answered = answering.await;
            let answered =
                answered.unwrap_or_else(|panic| self.failure(number, &ApiError::hidden(ErrorCode::Internal, &panic)));
            for piece in answered.pieces {
                if frames.send(Frame::data(piece)).await.is_err() {
                    return;
                }
            }
        }
    }
}
