//! Work for a model's workers, from the moment a request's body is there.

use std::time::Instant;

use axum::body::Bytes;

use super::App;
use super::error::ApiError;
use super::scan::Wish;
use super::terms::Terms;
use crate::catalogue::Offer;
use crate::pipeline::{Fit, Pipeline, ScanAnswer};
use crate::stopwatch::{Stage, StageTimes};
use crate::streams::{Place, Superseded};
use crate::worker::Caller;

/// What work gives.
pub(crate) trait Output: Send + 'static {
    /// Time by stage.
    fn times(&mut self) -> &mut StageTimes;

    /// Of a scan, how it fitted the model.
    fn fit(&self) -> Option<&Fit>;
}

impl App {
    /// Has a model's workers make a scan realistic.
    pub(crate) async fn scan(
        &self,
        wish: &Wish,
        entered: (Option<Place>, Option<Superseded>),
        bytes: Bytes,
    ) -> Result<ScanAnswer, ApiError> {
        let job = wish.job(bytes, &self.limits);
        let work = move |pipeline: &mut Pipeline, caller: Caller<'_>| Ok(pipeline.run(&job, caller)?);
        self.work(&wish.offer, &wish.terms, entered, work).await
    }

    /// Has a model's workers do something, on the terms of a request that has [entered](Terms::enter) its stream, and books it.
    pub(crate) async fn work<O: Output>(
        &self,
        offer: &Offer,
        terms: &Terms,
        (place, superseded): (Option<Place>, Option<Superseded>),
        work: impl FnOnce(&mut Pipeline, Caller<'_>) -> Result<O, ApiError> + Send + 'static,
    ) -> Result<O, ApiError> {
        let started = Instant::now();
        let running = async {
            let pool = self.catalogue.pool(offer).await?;
            let begin = move |pipeline: &mut Pipeline, caller: Caller<'_>| {
                drop(place);
                work(pipeline, caller)
            };
            Ok::<_, ApiError>(pool.run(begin).await?)
        };
        let done = terms.wait(superseded, running).await?;
        let mut output = done.output.inspect_err(|_| offer.statistics.failed(started.elapsed()))?;
        output.times().set(Stage::Queue, done.queued_for);
        let times = *output.times();
        offer.statistics.succeeded(&times);
        self.metrics.worked(&times, output.fit());
        Ok(output)
    }
}

impl Output for ScanAnswer {
    fn times(&mut self) -> &mut StageTimes {
        &mut self.times
    }

    fn fit(&self) -> Option<&Fit> {
        Some(&self.fit)
    }
}
