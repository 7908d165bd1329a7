//! The models that a running service offers, and the workers behind each.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread::available_parallelism;

use thiserror::Error;
use tokio::sync::OnceCell;

use crate::model::Model;
use crate::pipeline::{Pipeline, PipelineError};
use crate::repository::{Repository, RepositoryError};
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
    pub threads: usize,
    /// Scans that may wait for a worker.
    pub queue: usize,
}

/// Every version of every model that the repository had when the service started.
#[derive(Debug)]
pub struct Catalogue {
    default: String,
    options: WorkerOptions,
    models: BTreeMap<String, BTreeMap<u64, Arc<Offer>>>,
}

/// A model on offer. Its workers start with the first scan for it.
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
    /// Reads every model of a repository. One that is damaged is left out, with a warning in the log, unless it is the newest version
    /// of the default model: then it is an error.
    pub fn read(repository: &Repository, default: &str, options: WorkerOptions) -> Result<Self, CatalogueError> {
        let offer = |model: Model, version| {
            Arc::new(Offer { model: model.into(), version, statistics: Statistics::default(), pool: OnceCell::new() })
        };
        let mut models: BTreeMap<String, BTreeMap<u64, Arc<Offer>>> = BTreeMap::new();
        let newest = repository.read(default, None)?;
        let newest_version = newest.version.unwrap_or_default();
        models.entry(default.into()).or_default().insert(newest_version, offer(newest, newest_version));
        for name in repository.names()? {
            for version in repository.versions(&name)? {
                let versions = models.entry(name.clone()).or_default();
                if versions.contains_key(&version) {
                    continue;
                }
                match repository.read(&name, Some(version)) {
                    Ok(model) => drop(versions.insert(version, offer(model, version))),
                    Err(error) => tracing::warn!("left out: {error}"),
                }
            }
        }
        models.retain(|_, versions| !versions.is_empty());
        Ok(Self { default: default.into(), options, models })
    }

    /// Name of the model that is used where none is named.
    pub fn default_model(&self) -> &str {
        &self.default
    }

    /// What the workers of each model are given.
    pub fn options(&self) -> WorkerOptions {
        self.options
    }

    /// Every model with its versions, oldest first.
    pub fn models(&self) -> impl Iterator<Item = (&str, impl DoubleEndedIterator<Item = &Offer>)> {
        self.models.iter().map(|(name, versions)| (name.as_str(), versions.values().map(|offer| &**offer)))
    }

    /// A model: the default one unless named, its newest version unless another is named.
    pub fn find(&self, name: Option<&str>, version: Option<u64>) -> Result<&Arc<Offer>, RepositoryError> {
        let name = name.unwrap_or(&self.default);
        let versions = self.models.get(name);
        let newest = versions.and_then(|versions| versions.last_key_value());
        let (Some(versions), Some((_, newest))) = (versions, newest) else {
            let known = self.models.keys().cloned().collect();
            // What was asked for is shown again, but not at any length.
            return Err(RepositoryError::UnknownName { name: name.chars().take(80).collect(), known });
        };
        let Some(version) = version else { return Ok(newest) };
        versions.get(&version).ok_or_else(|| RepositoryError::UnknownVersion {
            name: name.into(),
            version,
            known: versions.keys().copied().collect(),
        })
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
    let size = Size { name: format!("scan-{}", model.name), workers: options.workers, queue: options.queue };
    let model = Arc::clone(model);
    Pool::start(&size, move || Pipeline::new(&model, options.threads))
}

impl Offer {
    /// True if a scan would be taken now; workers that have not started have nothing to do yet.
    pub(crate) fn has_room(&self) -> bool {
        self.pool.get().is_none_or(Pool::has_room)
    }

    /// Scans that wait; `None` where no workers have started.
    pub(crate) fn waiting(&self) -> Option<usize> {
        self.pool.get().map(Pool::waiting)
    }
}

impl Default for WorkerOptions {
    fn default() -> Self {
        Self { workers: 1, threads: available_parallelism().map_or(1, usize::from), queue: 32 }
    }
}
