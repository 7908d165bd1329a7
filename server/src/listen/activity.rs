//! Whether a connection has a request under way, and since when not.

use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::Bytes;
use hyper::body::{Body, Frame, SizeHint};
use tokio::time::Instant;

/// The requests of one connection.
#[derive(Clone, Debug)]
pub(super) struct Activity(Arc<Mutex<State>>);

#[derive(Debug)]
struct State {
    under_way: usize,
    since: Instant,
}

/// A request under way; ends when dropped.
#[derive(Debug)]
pub(super) struct UnderWay(Activity);

/// A body that keeps its request under way until it is sent.
#[derive(Debug)]
pub(super) struct Sent<B> {
    body: B,
    _under_way: UnderWay,
}

impl Activity {
    pub(super) fn new() -> Self {
        Self(Arc::new(Mutex::new(State { under_way: 0, since: Instant::now() })))
    }

    pub(super) fn begin(&self) -> UnderWay {
        self.lock().under_way += 1;
        UnderWay(self.clone())
    }

    /// Completes once no request has been under way for so long.
    pub(super) async fn idle_for(&self, time: Duration) {
        loop {
            let until = {
                let state = self.lock();
                let since = if state.under_way > 0 { Instant::now() } else { state.since };
                since + time
            };
            if until <= Instant::now() {
                return;
            }
            tokio::time::sleep_until(until).await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<B> Sent<B> {
    pub(super) fn new(body: B, under_way: UnderWay) -> Self {
        Self { body, _under_way: under_way }
    }
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        state.under_way -= 1;
        state.since = Instant::now();
    }
}

impl<B: Body<Data = Bytes> + Unpin> Body for Sent<B> {
    type Data = Bytes;
    type Error = B::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, B::Error>>> {
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_connection_is_idle_only_when_its_last_request_is_over() {
        let (activity, started) = (Activity::new(), Instant::now());
        let (first, second) = (activity.begin(), activity.begin());
        let ends = async {
            tokio::time::sleep(Duration::from_secs(25)).await;
            drop(first);
            tokio::time::sleep(Duration::from_secs(8)).await;
            drop(second);
        };
        tokio::join!(ends, activity.idle_for(Duration::from_secs(10)));
        assert_eq!(started.elapsed().as_secs(), 43);
    }
}
