//! The running service: start it, learn its address, stop it.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use thiserror::Error;
use tokio::runtime::Runtime;
use tokio_util::sync::CancellationToken;

use crate::address::Address;
use crate::canary::{Canaries, CanaryError};
use crate::catalogue::{Catalogue, CatalogueError};
use crate::config::{AdminOptions, Config, StopOptions};
use crate::http::{self, App};
use crate::listen::{Guests, Listener, listen};
use crate::loader::{Loader, poll};
use crate::metrics::Metrics;
use crate::repository::Repository;
use crate::source::Source;
use crate::tls::{TlsError, TlsFiles};
use crate::traces::{Traces, TracesError};

/// A running service. Dropping it stops it.
#[derive(Debug)]
pub struct Server {
    addr: Address,
    admin_addr: Option<SocketAddr>,
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
    /// The certificate or its key cannot be used.
    #[error(transparent)]
    Tls(#[from] TlsError),
    /// Traces cannot be sent.
    #[error(transparent)]
    Traces(#[from] TracesError),
    /// A model has two canaries.
    #[error(transparent)]
    Canary(#[from] CanaryError),
    /// The admin listener's address is one that other machines reach.
    #[error("the admin listener's address {0} is not a loopback address")]
    AdminAddress(SocketAddr),
    /// The address cannot be listened at.
    #[error("cannot listen at {addr}: {source}")]
    Listen {
        /// The address.
        addr: Address,
        /// The system's reason.
        source: io::Error,
    },
    /// The system does not give threads, signals or sockets.
    #[error("the service's runtime: {0}")]
    Runtime(#[from] io::Error),
}

/// Starts the service: reads and checks every model, starts the default model's workers, listens. Returns once scans are taken.
pub fn serve(config: &Config) -> Result<Server, ServeError> {
    let (inflight, body) = (config.requests.max_inflight_bytes, config.requests.max_body_bytes);
    if inflight < body {
        return Err(ServeError::Limits { inflight, body });
    }
    if let Some(admin) = config.admin.as_ref().filter(|admin| !admin.addr.ip().to_canonical().is_loopback()) {
        return Err(ServeError::AdminAddress(admin.addr));
    }
    let traces = Traces::new(config.otlp.as_deref())?;
    let tls = config.tls.as_ref().map(TlsFiles::acceptor).transpose()?;
    let (stop, end, metrics) = (CancellationToken::new(), CancellationToken::new(), Metrics::new());
    let (catalogue, loader) = read_models(config, &metrics, &end)?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().thread_name("http").build()?;
    let default = catalogue.find(None, None, None).map_err(CatalogueError::from)?;
    runtime.block_on(catalogue.pool(&default))?;
    let (listener, addr) = bind(&runtime, &config.addr, config.socket_mode)?;
    let bind_admin = |admin: &AdminOptions| bind(&runtime, &admin.addr.into(), config.socket_mode);
    let admin_listener = config.admin.as_ref().map(bind_admin).transpose()?;
    let admin_addr = admin_listener.as_ref().and_then(|(_, addr)| addr.tcp());

    let app = Arc::new(App::new(catalogue, (metrics, traces), config, end.clone()));
    let guests = |router, tls| Guests {
        router,
        limits: config.connections,
        open: app.metrics.connections(),
        refused: app.metrics.refused_connections(),
        tls,
    };
    let router = http::router(Arc::clone(&app), config.page, config.token.clone());
    let serving = listen(listener, guests(router, tls), end.clone());
    let admin = admin_listener.zip(config.admin.clone()).map(|((listener, _), admin)| {
        let router = http::admin::router(Arc::clone(&app), Arc::clone(&loader), admin.token);
        listen(listener, guests(router, None), end.clone())
    });
    let polling = config.poll.map(|every| poll(loader, every, end.clone()));
    let serving = async {
        tokio::join!(serving, if_some(admin), if_some(polling));
    };
    let time_over = stop_in_order(Arc::clone(&app), stop.clone(), end, config.stop);
    let thread = thread::Builder::new().name("serve".into()).spawn(move || {
        run(&runtime, serving, time_over);
        app.traces.end();
    })?;
    Ok(Server { addr, admin_addr, stop, thread: Some(thread) })
}

/// Every model of the folder, checked, and the one who changes what is on offer later.
fn read_models(
    config: &Config,
    metrics: &Metrics,
    end: &CancellationToken,
) -> Result<(Arc<Catalogue>, Arc<Loader>), ServeError> {
    let canaries = Canaries::new(&config.canaries)?;
    let repository = Repository::new(&config.models).with_max_model_bytes(config.max_model_bytes);
    let source = Source { repository, check: config.check.clone(), stop: end.clone() };
    let read = || {
        if source.repository.versions(&config.default_model)?.is_empty() {
            return Err(source.repository.unknown(&config.default_model)?);
        }
        // Seen before they are read: what changes meanwhile is seen as a change.
        Ok((source.published()?, source.read_all()?))
    };
    let (seen, models) = read().map_err(CatalogueError::Repository)?;
    let catalogue = Arc::new(Catalogue::new(&config.default_model, config.workers, canaries, models));
    let loader = Loader::new(source, seen, Arc::clone(&catalogue), metrics.loads());
    Ok((catalogue, Arc::new(loader)))
}

async fn if_some(future: Option<impl Future<Output = ()>>) {
    if let Some(future) = future {
        future.await;
    }
}

fn bind(runtime: &Runtime, addr: &Address, socket_mode: u32) -> Result<(Listener, Address), ServeError> {
    let bound = runtime.block_on(Listener::bind(addr, socket_mode)).and_then(|listener| {
        let addr = listener.address()?;
        Ok((listener, addr))
    });
    bound.map_err(|source| ServeError::Listen { addr: addr.clone(), source })
}

impl Server {
    /// The address that the service listens at.
    pub fn addr(&self) -> &Address {
        &self.addr
    }

    /// The address that the admin listener listens at, if there is one.
    pub fn admin_addr(&self) -> Option<SocketAddr> {
        self.admin_addr
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
