//! The certificate by which the service is known.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use thiserror::Error;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::{self, PemObject};
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::sign::{CertifiedKey, SingleCertAndKey};
use tokio_rustls::rustls::{self, ServerConfig};

/// The files of a certificate and its key, both PEM.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TlsFiles {
    /// The service's certificate, followed by those that vouch for it.
    pub cert: PathBuf,
    /// The private key of the first of them.
    pub key: PathBuf,
}

/// A certificate or key that cannot be used.
#[derive(Debug, Error)]
pub enum TlsError {
    /// A file cannot be read.
    #[error("TLS file {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A file is not PEM, or is damaged.
    #[error("TLS file {}: not PEM: {source}", path.display())]
    NotPem {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: pem::Error,
    },
    /// A file has nothing of what it is for.
    #[error("TLS file {}: no `-----BEGIN {expected}-----` in it", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// What is looked for.
        expected: &'static str,
    },
    /// What is in a file is no certificate, or no key of a known kind.
    #[error("TLS file {}: {source}", path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: rustls::Error,
    },
    /// The key is another certificate's.
    #[error("TLS file {}: not the key of the first certificate of {}", key.display(), cert.display())]
    OtherKey {
        /// The key's file.
        key: PathBuf,
        /// The certificate's file.
        cert: PathBuf,
    },
    /// The library takes none of its own defaults.
    #[error("TLS: {0}")]
    Library(rustls::Error),
}

impl TlsFiles {
    /// Reads the files; speaks HTTP/2 or HTTP/1.1 over TLS 1.2 or 1.3.
    pub(crate) fn acceptor(&self) -> Result<TlsAcceptor, TlsError> {
        let certified = self.read()?;
        let mut config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .map_err(TlsError::Library)?
            .with_no_client_auth()
            .with_cert_resolver(Arc::new(SingleCertAndKey::from(certified)));
        config.alpn_protocols = vec![b"h2".to_vec(), b"http/1.1".to_vec()];
        Ok(TlsAcceptor::from(Arc::new(config)))
    }

    fn read(&self) -> Result<CertifiedKey, TlsError> {
        let not_pem = |path: &Path| {
            let path = path.to_owned();
            |source| TlsError::NotPem { path, source }
        };
        let chain = CertificateDer::pem_slice_iter(&contents(&self.cert)?).collect::<Result<Vec<_>, _>>();
        let chain = chain.map_err(not_pem(&self.cert))?;
        if chain.is_empty() {
            return Err(TlsError::Missing { path: self.cert.clone(), expected: "CERTIFICATE" });
        }
        let key = PrivateKeyDer::from_pem_slice(&contents(&self.key)?).map_err(|error| match error {
            pem::Error::NoItemsFound => TlsError::Missing { path: self.key.clone(), expected: "PRIVATE KEY" },
            error => not_pem(&self.key)(error),
        })?;
        CertifiedKey::from_der(chain, key, &ring::default_provider()).map_err(|source| match source {
            rustls::Error::InconsistentKeys(_) => TlsError::OtherKey { key: self.key.clone(), cert: self.cert.clone() },
            rustls::Error::InvalidCertificate(_) => TlsError::Unusable { path: self.cert.clone(), source },
            source => TlsError::Unusable { path: self.key.clone(), source },
        })
    }
}

fn contents(path: &Path) -> Result<Vec<u8>, TlsError> {
    fs::read(path).map_err(|source| TlsError::Io { path: path.into(), source })
}
