//! Models on their way onto and off the offer while the service runs.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio_util::sync::CancellationToken;

use crate::catalogue::{Catalogue, CatalogueError, Offer};
use crate::metrics::Loads;
use crate::repository::RepositoryError;
use crate::source::{Published, Source};

/// Loads and unloads models, one at a time.
#[derive(Debug)]
pub(crate) struct Loader {
    source: Source,
    catalogue: Arc<Catalogue>,
    loads: Loads,
    turn: Mutex<()>,
    /// What [`look`](Self::look) saw last.
    seen: Mutex<Published>,
    /// Of models whose last change was no success, why.
    reasons: Mutex<BTreeMap<String, String>>,
}

/// A version of the repository's index.
#[derive(Debug)]
pub(crate) struct Entry {
    pub(crate) name: String,
    pub(crate) version: u64,
    /// The version on offer; otherwise why there is none.
    pub(crate) offer: Result<Arc<Offer>, String>,
}

impl Loader {
    /// `seen` is what lay in the repository before the catalogue's models were read.
    pub(crate) fn new(source: Source, seen: Published, catalogue: Arc<Catalogue>, loads: Loads) -> Self {
        for name in catalogue.models().keys() {
            count(&loads, name, "loaded");
        }
        Self { source, catalogue, loads, turn: Mutex::default(), seen: seen.into(), reasons: Mutex::default() }
    }

    /// Offers a model's versions as they lie in the repository now: new ones are checked and warmed up, then all take the place of the
    /// old ones at once. After an error everything is as it was. Blocks.
    pub(crate) fn load(&self, name: &str) -> Result<Vec<Arc<Offer>>, CatalogueError> {
        let turn = lock(&self.turn);
        let loaded = self.read(name);
        match &loaded {
            Ok(versions) => {
                let replaced = self.catalogue.swap(name, versions.clone());
                lock(&self.reasons).remove(name);
                count(&self.loads, name, "loaded");
                drop((turn, replaced));
                let versions: Vec<String> = versions.keys().map(u64::to_string).collect();
                tracing::info!("model `{name}` is loaded, versions {}", versions.join(", "));
            }
            Err(error) => {
                lock(&self.reasons).insert(name.into(), error.to_string());
                count(&self.loads, name, "refused");
                tracing::warn!("model `{name}` stays as it was: {error}");
            }
        }
        Ok(loaded?.into_values().collect())
    }

    /// Takes a model off the offer; false if it was not on it.
    pub(crate) fn unload(&self, name: &str) -> bool {
        let turn = lock(&self.turn);
        let Some(replaced) = self.catalogue.swap(name, BTreeMap::new()) else { return false };
        lock(&self.reasons).insert(name.into(), "unloaded".into());
        drop((turn, replaced));
        tracing::info!("model `{name}` is unloaded");
        true
    }

    /// Every version that lies in the repository or is on offer.
    pub(crate) fn index(&self) -> Result<Vec<Entry>, RepositoryError> {
        let (models, reasons) = (self.catalogue.models(), lock(&self.reasons));
        let mut index = BTreeMap::new();
        for (name, versions) in self.source.published()? {
            let reason = reasons.get(&name).map_or("not loaded", String::as_str);
            for (version, _) in versions {
                index.insert((name.clone(), version), Err(reason.to_owned()));
            }
        }
        for offer in models.values().flat_map(BTreeMap::values) {
            index.insert((offer.model.name.clone(), offer.version), Ok(Arc::clone(offer)));
        }
        Ok(index.into_iter().map(|((name, version), offer)| Entry { name, version, offer }).collect())
    }

    /// Loads what is new or changed in the repository since the last look, and unloads what has gone. What was refused is not tried
    /// again until its files change. Blocks.
    pub(crate) fn look(&self) -> Result<(), RepositoryError> {
        let now = self.source.published()?;
        let before = std::mem::replace(&mut *lock(&self.seen), now.clone());
        for name in now.keys().filter(|name| before.get(*name) != now.get(*name)) {
            // Whatever goes wrong is in the log, and nothing has changed.
            let _ = self.load(name);
        }
        for name in before.keys().filter(|name| !now.contains_key(*name)) {
            // A folder that cannot be listed at the moment has not gone.
            if self.source.repository.versions(name).is_ok_and(|versions| versions.is_empty()) {
                self.unload(name);
            }
        }
        Ok(())
    }

    fn read(&self, name: &str) -> Result<BTreeMap<u64, Arc<Offer>>, CatalogueError> {
        let models = self.catalogue.models();
        let versions = self.source.repository.versions(name)?;
        if versions.is_empty() {
            return Err(self.source.repository.unknown(name)?.into());
        }
        let mut offers = BTreeMap::new();
        for version in versions {
            let offered = models.get(name).and_then(|versions| versions.get(&version));
            let offer = self.source.read(name, version, offered)?;
            if offered.is_none_or(|offered| !Arc::ptr_eq(offered, &offer)) {
                self.catalogue.warm_up(&offer)?;
            }
            offers.insert(version, offer);
        }
        Ok(offers)
    }
}

/// [Looks](Loader::look) again and again, until `stop`.
pub(crate) async fn poll(loader: Arc<Loader>, every: Duration, stop: CancellationToken) {
    while stop.run_until_cancelled(tokio::time::sleep(every)).await.is_some() {
        let loader = Arc::clone(&loader);
        match tokio::task::spawn_blocking(move || loader.look()).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => tracing::warn!("the repository cannot be looked at: {error}"),
            Err(error) => tracing::error!("a look at the repository failed: {error}"),
        }
    }
}

fn count(loads: &Loads, name: &str, outcome: &str) {
    loads.get_or_create(&[("model", name.into()), ("outcome", outcome.into())]).inc();
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
