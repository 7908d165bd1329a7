//! The folder of models: `<root>/<name>/<version>/model.onnx`, versions being whole numbers, the newest the largest.

use std::fs;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::model::{MAX_MODEL_BYTES, Model, ModelError};

/// Name of the file in a version's directory.
pub const MODEL_FILE: &str = "model.onnx";

/// Longest name of a model.
pub const MAX_NAME_LENGTH: usize = 64;

/// A folder of models.
#[derive(Clone, Debug)]
pub struct Repository {
    root: PathBuf,
    max_model_bytes: u64,
}

/// A model that the repository does not give.
#[derive(Debug, Error)]
pub enum RepositoryError {
    /// The folder cannot be listed.
    #[error("models folder {}: {source}", path.display())]
    Io {
        /// The folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// No model of this name.
    #[error("no model `{name}`; there are: {}", or_none(.known))]
    UnknownName {
        /// The name asked for.
        name: String,
        /// Names that there are.
        known: Vec<String>,
    },
    /// The model has no such version.
    #[error("model `{name}` has no version {version}; there are: {}", or_none(.known))]
    UnknownVersion {
        /// The model.
        name: String,
        /// The version asked for.
        version: u64,
        /// Versions that there are.
        known: Vec<u64>,
    },
    /// The file is no model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl Repository {
    /// A repository in this folder, whose files may have [`MAX_MODEL_BYTES`].
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into(), max_model_bytes: MAX_MODEL_BYTES }
    }

    /// The same with another bound on a file's bytes.
    #[must_use]
    pub fn with_max_model_bytes(self, max_model_bytes: u64) -> Self {
        Self { max_model_bytes, ..self }
    }

    /// Bytes that a file may have.
    pub fn max_model_bytes(&self) -> u64 {
        self.max_model_bytes
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Names of the models that have a version, sorted.
    pub fn names(&self) -> Result<Vec<String>, RepositoryError> {
        let mut names: Vec<String> = list(&self.root)?.into_iter().filter(|name| is_name(name)).collect();
        names.retain(|name| self.versions(name).is_ok_and(|versions| !versions.is_empty()));
        names.sort();
        Ok(names)
    }

    /// Versions of a model, oldest first; none where there is no such model.
    pub fn versions(&self, name: &str) -> Result<Vec<u64>, RepositoryError> {
        if !is_name(name) || !self.root.join(name).is_dir() {
            return Ok(Vec::new());
        }
        let mut versions: Vec<u64> = list(&self.root.join(name))?.iter().filter_map(|dir| version_of(dir)).collect();
        versions.retain(|version| self.path(name, *version).is_file());
        versions.sort_unstable();
        Ok(versions)
    }

    /// Reads and checks a model, its newest version unless another is named.
    pub fn read(&self, name: &str, version: Option<u64>) -> Result<Model, RepositoryError> {
        let versions = self.versions(name)?;
        let Some(newest) = versions.last() else { return Err(self.unknown(name)?) };
        let version = version.unwrap_or(*newest);
        if !versions.contains(&version) {
            return Err(RepositoryError::UnknownVersion { name: name.into(), version, known: versions });
        }
        let mut model = Model::read(&self.path(name, version), self.max_model_bytes)?;
        (model.name, model.version) = (name.into(), Some(version));
        Ok(model)
    }

    /// The error of a name that no model has.
    pub(crate) fn unknown(&self, name: &str) -> Result<RepositoryError, RepositoryError> {
        // What was asked for is shown again, but not at any length.
        Ok(RepositoryError::UnknownName { name: name.chars().take(80).collect(), known: self.names()? })
    }

    /// Where a version's file lies.
    pub(crate) fn path(&self, name: &str, version: u64) -> PathBuf {
        self.root.join(name).join(version.to_string()).join(MODEL_FILE)
    }
}

/// A name is one path component and nothing that a shell, a URL or a header would have to quote: letters, digits, `-`, `_`, `.`,
/// not led by a dot.
pub fn is_name(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    !name.is_empty() && name.len() <= MAX_NAME_LENGTH && !name.starts_with('.') && name.chars().all(plain)
}

/// Version of a directory's name; `007` is none, as it would be a second 7.
fn version_of(directory: &str) -> Option<u64> {
    directory.parse().ok().filter(|version: &u64| version.to_string() == directory)
}

fn list(path: &Path) -> Result<Vec<String>, RepositoryError> {
    let fail = |source| RepositoryError::Io { path: path.into(), source };
    let mut names = Vec::new();
    for entry in fs::read_dir(path).map_err(fail)? {
        names.extend(entry.map_err(fail)?.file_name().into_string());
    }
    Ok(names)
}

fn or_none<T: ToString>(list: &[T]) -> String {
    if list.is_empty() { "none".into() } else { list.iter().map(T::to_string).collect::<Vec<_>>().join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_version_is_the_largest_number() -> Result<(), Box<dyn std::error::Error>> {
        let root = tempfile::tempdir()?;
        for version in ["2", "10", "007", "x", "-1"] {
            let dir = root.path().join("street").join(version);
            fs::create_dir_all(&dir)?;
            fs::write(dir.join(MODEL_FILE), "")?;
        }
        fs::create_dir_all(root.path().join("street/11"))?;
        fs::create_dir_all(root.path().join("empty"))?;
        let repository = Repository::new(root.path());
        assert_eq!(repository.versions("street")?, [2, 10]);
        assert_eq!(repository.names()?, ["street"]);
        let error = repository.read("street", Some(3)).map_err(|e| e.to_string());
        assert_eq!(error.err(), Some("model `street` has no version 3; there are: 2, 10".into()));
        Ok(())
    }

    #[test]
    fn a_name_cannot_leave_the_folder() -> Result<(), Box<dyn std::error::Error>> {
        let root = tempfile::tempdir()?;
        let inside = root.path().join("models");
        fs::create_dir_all(root.path().join("outside/1"))?;
        fs::create_dir_all(&inside)?;
        fs::write(root.path().join("outside/1").join(MODEL_FILE), "")?;
        for name in ["../outside", "..", ".", "", "/outside", "a/b", "a\\b", "%2e%2e", "a b", "x\0", &"n".repeat(65)] {
            assert!(!is_name(name), "{name}");
            let read = Repository::new(&inside).read(name, None);
            assert!(matches!(read, Err(RepositoryError::UnknownName { .. })), "{name}");
        }
        assert!(is_name("hdl64e-v2.1_x"));
        Ok(())
    }
}
