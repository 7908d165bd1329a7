//! The running service: start it, learn its address, stop it.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use axum::serve::ListenerExt;
use thiserror::Error;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio::sync::oneshot;

use crate::catalogue::{Catalogue, CatalogueError, WorkerOptions};
use crate::http::{self, App};
use crate::repository::Repository;

/// What a service is started with.
#[derive(Clone, Debug)]
pub struct Config {
    /// The folder of models.
    pub models: PathBuf,
    /// The model that is used where a request names none.
    pub default_model: String,
    /// Address to listen at; port 0 takes a free one.
    pub addr: SocketAddr,
    /// Workers of each model.
    pub workers: WorkerOptions,
    /// Bytes that a body may have.
    pub max_body_bytes: usize,
    /// Points that a scan may have.
    pub max_points: usize,
    /// Time that requests under way get to finish when the service stops.
    pub grace: Duration,
}

/// A running service. Dropping it stops it.
#[derive(Debug)]
pub struct Server {
    addr: SocketAddr,
    app: Arc<App>,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

/// A service that does not start, or ended badly.
#[derive(Debug, Error)]
pub enum ServeError {
    /// The models are not fit to serve.
    #[error(transparent)]
    Models(#[from] CatalogueError),
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
    let catalogue = Catalogue::read(&Repository::new(&config.models), &config.default_model, config.workers)?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().thread_name("http").build()?;
    let default = catalogue.find(None, None).map_err(CatalogueError::from)?;
    runtime.block_on(catalogue.pool(default))?;
    let listen = |source| ServeError::Listen { addr: config.addr, source };
    let listener = runtime.block_on(TcpListener::bind(config.addr)).map_err(listen)?;
    let addr = listener.local_addr().map_err(listen)?;
    let app = Arc::new(App {
        catalogue,
        max_body_bytes: config.max_body_bytes,
        max_points: config.max_points,
        draining: AtomicBool::new(false),
    });
    let (stop, stopped) = oneshot::channel();
    let (router, grace) = (http::router(Arc::clone(&app)), config.grace);
    let accept = move || accept(&runtime, listener, router, stopped, grace);
    let thread = thread::Builder::new().name("serve".into()).spawn(accept)?;
    Ok(Server { addr, app, stop: Some(stop), thread: Some(thread) })
}

impl Server {
    /// The address that the service listens at.
    pub fn addr(&self) -> SocketAddr {
        self.addr
    }

    /// Stops accepting, lets requests under way finish within the grace, and returns.
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
        self.app.draining.store(true, Ordering::Relaxed);
        if let Some(stop) = self.stop.take() {
            // The service may have ended by itself.
            let _ = stop.send(());
        }
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(ended)) => Ok(ended?),
            Some(Err(_)) => Err(ServeError::Runtime(io::Error::other("the thread panicked"))),
            None => Ok(()),
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

/// Serves until told to stop, and for the grace after that.
fn accept(
    runtime: &Runtime,
    listener: TcpListener,
    router: axum::Router,
    stopped: oneshot::Receiver<()>,
    grace: Duration,
) -> io::Result<()> {
    runtime.block_on(async move {
        let (draining, drained) = oneshot::channel();
        let told = async move {
            // A sender that is gone means the same.
            let _ = stopped.await;
            let _ = draining.send(());
        };
        let listener = listener.tap_io(|connection| {
            // Answers go out whole; without this the last packet may wait for an acknowledgement.
            let _ = connection.set_nodelay(true);
        });
        let serving = axum::serve(listener, router).with_graceful_shutdown(told);
        let too_late = async move {
            let _ = drained.await;
            tokio::time::sleep(grace).await;
        };
        tokio::select! {
            ended = serving => ended,
            () = too_late => {
                tracing::warn!("requests were still under way after {} s; they are cut off", grace.as_secs_f64());
                Ok(())
            }
        }
    })
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
