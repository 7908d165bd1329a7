//! The models that a running service offers, and the workers behind each.

use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError, RwLock};
use std::thread::available_parallelism;

use runtime::Threads;
use thiserror::Error;
use tokio::sync::OnceCell;

use crate::batch::{Batches, Sharing};
use crate::canary::Canaries;
use crate::model::Model;
use crate::pipeline::{Pipeline, PipelineError};
use crate::repository::RepositoryError;
use crate::statistics::Statistics;
use crate::worker::{Pool, Size};

/// The workers of one model.
pub(crate) type ScanPool = Pool<Pipeline>;

/// What the workers of each model are given.
#[derive(Clone, Copy, Debug)]
pub struct WorkerOptions {
    /// Worker threads a model, each with a session of its own.
    pub workers: usize,
    /// Threads within an operator, for each worker.
    pub threads: Threads,
    /// Scans that a worker may take at once, to run them as one batch; 1 runs each alone. A model whose file fixes the batch takes one.
    pub batch: usize,
    /// Scans that may wait while all workers have one; 0 turns away whoever would have to wait.
    pub queue: usize,
}

/// Models by name and version.
pub type Models = BTreeMap<String, BTreeMap<u64, Arc<Offer>>>;

/// The models on offer. What is on offer changes as a whole: whoever has taken an offer, or all of them, keeps what he has.
#[derive(Debug)]
pub struct Catalogue {
    default: String,
    options: WorkerOptions,
    canaries: Canaries,
    models: RwLock<Arc<Models>>,
}

/// A model on offer. Its workers start with the first scan for it, or before it is offered.
#[derive(Debug)]
pub struct Offer {
    /// The model.
    pub model: Arc<Model>,
    /// Its version.
    pub version: u64,
    /// What became of the work that it was given.
    pub statistics: Statistics,
    pool: OnceCell<ScanPool>,
}

/// A catalogue that cannot be made, or has not what it was asked for.
#[derive(Debug, Error)]
pub enum CatalogueError {
    /// The repository does not give a model.
    #[error(transparent)]
    Repository(#[from] RepositoryError),
    /// A model's workers do not start.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The thread that starts the workers panicked.
    #[error("the start of model `{0}` panicked")]
    Panicked(String),
}

impl Catalogue {
    /// A catalogue of these models; `default` is used where none is named.
    pub(crate) fn new(default: &str, options: WorkerOptions, canaries: Canaries, models: Models) -> Self {
        Self { default: default.into(), options, canaries, models: RwLock::new(models.into()) }
    }

    /// Name of the model that is used where none is named.
    pub fn default_model(&self) -> &str {
        &self.default
    }

    /// What the workers of each model are given.
    pub fn options(&self) -> WorkerOptions {
        self.options
    }

    /// Every model that is on offer now.
    pub fn models(&self) -> Arc<Models> {
        Arc::clone(&self.models.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// A model: the default one unless named; the version named, or else the one for the stream: its newest but for a canary.
    pub fn find(
        &self,
        name: Option<&str>,
        version: Option<u64>,
        stream: Option<&str>,
    ) -> Result<Arc<Offer>, RepositoryError> {
        let (models, name) = (self.models(), name.unwrap_or(&self.default));
        let unknown_name = || {
            let known = models.keys().cloned().collect();
            // What was asked for is shown again, but not at any length.
            RepositoryError::UnknownName { name: name.chars().take(80).collect(), known }
        };
        let versions = models.get(name).ok_or_else(unknown_name)?;
        let offer = match version {
            Some(version) => versions.get(&version).ok_or_else(|| {
                let known = versions.keys().copied().collect();
                RepositoryError::UnknownVersion { name: name.into(), version, known }
            })?,
            None => self.canaries.choose(name, versions, stream).ok_or_else(unknown_name)?,
        };
        Ok(Arc::clone(offer))
    }

    /// Puts other versions of a model in the place of those it had, or takes it off the offer where there are none. Returns those it had.
    pub(crate) fn swap(&self, name: &str, versions: BTreeMap<u64, Arc<Offer>>) -> Option<BTreeMap<u64, Arc<Offer>>> {
        let mut now = self.models.write().unwrap_or_else(PoisonError::into_inner);
        let mut models = Models::clone(&now);
        let replaced = if versions.is_empty() { models.remove(name) } else { models.insert(name.into(), versions) };
        *now = Arc::new(models);
        replaced
    }

    /// Starts the workers of a model that is not on offer yet; each has tried it on an empty scan. Blocks.
    pub(crate) fn warm_up(&self, offer: &Offer) -> Result<(), CatalogueError> {
        let pool = start_pool(&offer.model, self.options)?;
        // If they had started meanwhile, those are as good.
        let _ = offer.pool.set(pool);
        Ok(())
    }

    /// The workers of a model, started if they were not.
    pub(crate) async fn pool<'a>(&self, offer: &'a Offer) -> Result<&'a ScanPool, CatalogueError> {
        let options = self.options;
        let start = || async move {
            let model = Arc::clone(&offer.model);
            let started = tokio::task::spawn_blocking(move || start_pool(&model, options)).await;
            started.map_err(|_| CatalogueError::Panicked(offer.model.name.clone()))?.map_err(CatalogueError::from)
        };
        offer.pool.get_or_try_init(start).await
    }
}

fn start_pool(model: &Arc<Model>, options: WorkerOptions) -> Result<ScanPool, PipelineError> {
    let most = if model.takes_batches() { options.batch.max(1) } else { 1 };
    let size = Size { name: format!("scan-{}", model.name), workers: options.workers * most, queue: options.queue };
    let model = Arc::clone(model);
    if most == 1 {
        return Pool::start(&size, move || Pipeline::new(&model, options.threads));
    }
    let sharing = Sharing { sessions: options.workers, threads: options.threads, most, callers: size.workers };
    let batches = Arc::new(Batches::start(&model, sharing)?);
    Pool::start(&size, move || Pipeline::sharing(&model, &batches))
}

impl Offer {
    pub(crate) fn new(model: Model, version: u64) -> Self {
        Self { model: model.into(), version, statistics: Statistics::default(), pool: OnceCell::new() }
    }

    /// True if a scan would be taken now; workers that have not started have nothing to do yet.
    pub(crate) fn has_room(&self) -> bool {
        self.pool.get().is_none_or(Pool::has_room)
    }

    /// Scans that wait; `None` where no workers have started.
    pub(crate) fn waiting(&self) -> Option<usize> {
        self.pool.get().map(Pool::waiting)
    }
}

impl Drop for Offer {
    /// The last one to let go of an offer may be an async handler, which must not wait for the workers to end.
    fn drop(&mut self) {
        let Some(pool) = self.pool.take() else { return };
        match tokio::runtime::Handle::try_current() {
            Ok(runtime) => drop(runtime.spawn_blocking(move || drop(pool))),
            Err(_) => drop(pool),
        }
    }
}

impl Default for WorkerOptions {
    fn default() -> Self {
        Self { workers: 1, threads: available_parallelism().map_or(1, usize::from).into(), batch: 1, queue: 32 }
    }
}
