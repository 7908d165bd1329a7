//! Connections: let in up to a number, served within time limits, ended when the service ends.

mod activity;
mod connection;
mod listener;
#[cfg(unix)]
mod unix_socket;

use std::io::{self, ErrorKind};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::gauge::Gauge;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::config::ConnectionLimits;
pub(crate) use listener::Listener;
use listener::Stream;

/// Pause after the system had no resources for a connection.
const BREATHER: Duration = Duration::from_millis(200);

/// How connections are received.
pub(crate) struct Guests {
    pub(crate) router: Router,
    pub(crate) limits: ConnectionLimits,
    /// The number of those that are open.
    pub(crate) open: Gauge,
    /// Counts those that were one too many.
    pub(crate) refused: Counter,
    /// Shakes hands with each one first.
    pub(crate) tls: Option<TlsAcceptor>,
}

/// A connection's place among those that are open; given back when dropped.
struct Place {
    open: Gauge,
    _permit: OwnedSemaphorePermit,
}

/// Serves connections until `stop`, then until the last request under way is answered.
pub(crate) async fn listen(
    listener: Listener,
    Guests { router, limits, open, refused, tls }: Guests,
    stop: CancellationToken,
) {
    let (connections, places) = (TaskTracker::new(), Arc::new(Semaphore::new(limits.max)));
    loop {
        let accepted = tokio::select! {
            () = stop.cancelled() => break,
            accepted = listener.accept() => accepted,
        };
        let stream = match accepted {
            Ok(stream) => stream,
            Err(error) => {
                pause(&error).await;
                continue;
            }
        };
        if let Ok(permit) = Arc::clone(&places).try_acquire_owned() {
            let place = Place::take(&open, permit);
            let (router, stop, tls) = (router.clone(), stop.clone(), tls.clone());
            connections.spawn(async move {
                match tls {
                    None => connection::serve(stream, router, limits, stop).await,
                    Some(tls) => {
                        if let Some(stream) = handshake(&tls, stream, limits.idle_time, &stop).await {
                            connection::serve(stream, router, limits, stop).await;
                        }
                    }
                }
                drop(place);
            });
        } else {
            refused.inc();
            // To be told so over TLS would cost more than to be let in.
            if tls.is_none() {
                connections.spawn(connection::refuse(stream, limits.max));
            }
        }
    }
    drop(listener);
    connections.close();
    connections.wait().await;
}

impl Place {
    fn take(open: &Gauge, permit: OwnedSemaphorePermit) -> Self {
        open.inc();
        Self { open: open.clone(), _permit: permit }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.open.dec();
    }
}

/// The connection within a connection; `None` for a client that does not speak TLS, or takes longer than for a request's headers.
async fn handshake(
    tls: &TlsAcceptor,
    stream: Stream,
    time: Duration,
    stop: &CancellationToken,
) -> Option<TlsStream<Stream>> {
    let shaken = tokio::select! {
        shaken = tokio::time::timeout(time, tls.accept(stream)) => shaken.ok()?,
        () = stop.cancelled() => return None,
    };
    shaken.inspect_err(|error| tracing::debug!("no TLS with a client: {error}")).ok()
}

/// A connection that ended before it was accepted is its own affair; a lack of file descriptors lasts.
async fn pause(error: &io::Error) {
    if matches!(error.kind(), ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset | ErrorKind::ConnectionRefused)
    {
        return;
    }
    tracing::error!("no connection can be accepted: {error}");
    tokio::time::sleep(BREATHER).await;
}
