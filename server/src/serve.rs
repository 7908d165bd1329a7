//! The running service: start it, learn its address, stop it.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use thiserror::Error;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio_util::sync::CancellationToken;

use crate::catalogue::{Catalogue, CatalogueError};
use crate::config::{Config, StopOptions};
use crate::http::{self, App};
use crate::listen::{Guests, listen};
use crate::repository::Repository;

/// A running service. Dropping it stops it.
#[derive(Debug)]
pub struct Server {
    addr: SocketAddr,
    stop: CancellationToken,
    thread: Option<JoinHandle<()>>,
}

/// A service that does not start, or ended badly.
#[derive(Debug, Error)]
pub enum ServeError {
    /// The models are not fit to serve.
    #[error(transparent)]
    Models(#[from] CatalogueError),
    /// Limits that contradict each other.
    #[error(
        "max_inflight_bytes is {inflight}, less than the {body} of max_body_bytes: the largest bodies would never get in"
    )]
    Limits {
        /// Bytes of all requests.
        inflight: usize,
        /// Bytes of one body.
        body: usize,
    },
    /// The address cannot be listened at.
    #[error("cannot listen at {addr}: {source}")]
    Listen {
        /// The address.
        addr: SocketAddr,
        /// The system's reason.
        source: io::Error,
    },
    /// The system does not give threads, signals or sockets.
    #[error("the service's runtime: {0}")]
    Runtime(#[from] io::Error),
}

/// Starts the service: reads every model, starts the default model's workers, listens. Returns once scans are taken.
pub fn serve(config: &Config) -> Result<Server, ServeError> {
    let (inflight, body) = (config.requests.max_inflight_bytes, config.requests.max_body_bytes);
    if inflight < body {
        return Err(ServeError::Limits { inflight, body });
    }
    let catalogue = Catalogue::read(&Repository::new(&config.models), &config.default_model, config.workers)?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().thread_name("http").build()?;
    let default = catalogue.find(None, None).map_err(CatalogueError::from)?;
    runtime.block_on(catalogue.pool(default))?;
    let fail = |source| ServeError::Listen { addr: config.addr, source };
    let listener = runtime.block_on(TcpListener::bind(config.addr)).map_err(fail)?;
    let addr = listener.local_addr().map_err(fail)?;
    let app = Arc::new(App::new(catalogue, config.requests));
    let stop = CancellationToken::new();
    let (stopped, options) = (stop.clone(), config.stop);
    let end = CancellationToken::new();
    let refused = app.metrics.refused_connections();
    let guests = Guests { router: http::router(Arc::clone(&app)), limits: config.connections, refused };
    let serving = listen(listener, guests, end.clone());
    let run = move || run(&runtime, serving, stop_in_order(app, stopped, end, options));
    let thread = thread::Builder::new().name("serve".into()).spawn(run)?;
    Ok(Server { addr, stop, thread: Some(thread) })
}

impl Server {
    /// The address that the service listens at.
    pub fn addr(&self) -> SocketAddr {
        self.addr
    }

    /// Says that it is not ready, goes on for the lame duck's time, then takes no more, lets requests under way finish within the grace,
    /// and returns.
    pub fn stop(mut self) -> Result<(), ServeError> {
        self.end()
    }

    /// Waits for SIGTERM or an interrupt, then [stops](Self::stop).
    pub fn stop_at_signal(self) -> Result<(), ServeError> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        runtime.block_on(signal())?;
        tracing::info!("stopping");
        self.stop()
    }

    fn end(&mut self) -> Result<(), ServeError> {
        self.stop.cancel();
        match self.thread.take().map(JoinHandle::join) {
            Some(Err(_)) => Err(ServeError::Runtime(io::Error::other("the thread panicked"))),
            Some(Ok(())) | None => Ok(()),
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Err(error) = self.end() {
            tracing::error!("{error}");
        }
    }
}

/// Serves until all is answered or time is over.
fn run(runtime: &Runtime, serving: impl Future<Output = ()>, time_over: impl Future<Output = ()>) {
    runtime.block_on(async {
        tokio::select! {
            () = serving => {}
            () = time_over => tracing::warn!("requests were still under way at the end of the grace; they are cut off"),
        }
    });
}

/// Once told to stop: no longer ready, then, after the lame duck's time, the end of accepting. Completes when the grace is over.
async fn stop_in_order(app: Arc<App>, stopped: CancellationToken, end: CancellationToken, options: StopOptions) {
    stopped.cancelled().await;
    app.drain();
    tokio::time::sleep(options.lame_duck).await;
    end.cancel();
    tokio::time::sleep(options.grace).await;
}

/// Completes at SIGTERM or an interrupt.
async fn signal() -> io::Result<()> {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let mut terminate = signal(SignalKind::terminate())?;
        tokio::select! {
            _ = terminate.recv() => Ok(()),
            interrupt = tokio::signal::ctrl_c() => interrupt,
        }
    }
    #[cfg(not(unix))]
    tokio::signal::ctrl_c().await
}
