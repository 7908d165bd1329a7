//! Where models come from: files of the repository, checked before they are on offer.

use std::collections::BTreeMap;
use std::fs;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::SystemTime;

use tokio_util::sync::CancellationToken;

use crate::catalogue::{Models, Offer};
use crate::check::CheckOptions;
use crate::model::{self, Model, ModelError};
use crate::repository::{Repository, RepositoryError};

/// Versions that lie in the repository, by model, each with its file's time and length.
pub(crate) type Published = BTreeMap<String, Vec<(u64, Option<(SystemTime, u64)>)>>;

/// A repository, and how what lies in it is checked.
#[derive(Debug)]
pub(crate) struct Source {
    pub(crate) repository: Repository,
    pub(crate) check: CheckOptions,
    /// Gives up checks under way.
    pub(crate) stop: CancellationToken,
}

impl Source {
    /// Reads and checks a version; one that is on offer already stays as it is if its file does.
    pub(crate) fn read(
        &self,
        name: &str,
        version: u64,
        offered: Option<&Arc<Offer>>,
    ) -> Result<Arc<Offer>, RepositoryError> {
        let path = self.repository.path(name, version);
        let read = || {
            let bytes = model::read_file(&path, self.repository.max_model_bytes())?;
            if let Some(offer) = offered.filter(|offer| offer.model.digest == model::digest(&bytes)) {
                return Ok(Arc::clone(offer));
            }
            // The child goes first: it dies of what this process must not even parse.
            self.check.check(&bytes, &self.stop)?;
            let mut model = Model::from_bytes(bytes)?;
            (model.name, model.version) = (name.into(), Some(version));
            Ok(Arc::new(Offer::new(model, version)))
        };
        read().map_err(|problem| ModelError { path: path.clone(), problem }.into())
    }

    /// Reads and checks everything, two at a time.
    pub(crate) fn read_all(&self) -> Result<Models, RepositoryError> {
        let mut wanted = Vec::new();
        for name in self.repository.names()? {
            wanted.extend(self.repository.versions(&name)?.into_iter().map(|version| (name.clone(), version)));
        }
        let wanted = Mutex::new(wanted);
        let next = || wanted.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let read = || -> Result<_, RepositoryError> {
            let mut offers = Vec::new();
            while let Some((name, version)) = next() {
                offers.push(self.read(&name, version, None).inspect_err(|_| while next().is_some() {})?);
            }
            Ok(offers)
        };
        let halves = thread::scope(|scope| {
            let other = scope.spawn(read);
            let mine = read();
            [mine, other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))]
        });
        let mut models = Models::new();
        for offers in halves {
            for offer in offers? {
                models.entry(offer.model.name.clone()).or_default().insert(offer.version, offer);
            }
        }
        Ok(models)
    }

    /// What lies there now.
    pub(crate) fn published(&self) -> Result<Published, RepositoryError> {
        let of_name = |name: String| {
            let stamp = |version| {
                let file = fs::metadata(self.repository.path(&name, version)).ok()?;
                Some((file.modified().ok()?, file.len()))
            };
            let versions = self.repository.versions(&name)?;
            let versions = versions.into_iter().map(|version| (version, stamp(version))).collect();
            Ok((name, versions))
        };
        self.repository.names()?.into_iter().map(of_name).collect()
    }
}
