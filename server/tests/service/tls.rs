//! A service that is known by its certificate.

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use rcgen::{CertifiedKey, generate_simple_self_signed};
use server::{Config, TlsFiles, serve};
use tempfile::TempDir;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::CertificateDer;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::version::{TLS12, TLS13};
use tokio_rustls::rustls::{self, ClientConfig, ClientConnection, RootCertStore, StreamOwned};

use crate::support::{Result, Service, bin, config, wait_until};

/// A certificate for `localhost` and its key, in a folder.
struct Identity(TempDir);

impl Identity {
    fn new() -> Result<Self> {
        let folder = tempfile::tempdir()?;
        let CertifiedKey { cert, signing_key } = generate_simple_self_signed(["localhost".to_owned()])?;
        fs::write(folder.path().join("cert.pem"), cert.pem())?;
        fs::write(folder.path().join("key.pem"), signing_key.serialize_pem())?;
        Ok(Self(folder))
    }

    fn files(&self) -> TlsFiles {
        TlsFiles { cert: self.0.path().join("cert.pem"), key: self.0.path().join("key.pem") }
    }

    fn config(&self) -> Result<Config> {
        Ok(Config { tls: Some(self.files()), ..config()? })
    }

    /// What a client is told that trusts this certificate and no other.
    fn client(&self) -> Result<ClientConfig> {
        self.client_of(&[&TLS13, &TLS12])
    }

    fn client_of(&self, versions: &[&'static rustls::SupportedProtocolVersion]) -> Result<ClientConfig> {
        let mut roots = RootCertStore::empty();
        roots.add(CertificateDer::from_pem_file(self.files().cert)?)?;
        let client = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()));
        Ok(client.with_protocol_versions(versions)?.with_root_certificates(roots).with_no_client_auth())
    }
}

type Client = StreamOwned<ClientConnection, TcpStream>;

fn connect(service: &Service, config: ClientConfig) -> Result<Client> {
    let connection = ClientConnection::new(Arc::new(config), "localhost".try_into()?)?;
    Ok(StreamOwned::new(connection, service.connect()?))
}

/// Asks for a scan with the last request of a connection.
fn scan(client: &mut Client) -> Result<String> {
    let body = bin()?;
    write!(
        client,
        "POST /v1/scan HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-length: {}\r\n\r\n",
        body.len()
    )?;
    client.write_all(&body)?;
    let mut answer = Vec::new();
    client.read_to_end(&mut answer)?;
    Ok(String::from_utf8_lossy(&answer).into_owned())
}

#[test]
fn whoever_trusts_the_certificate_is_answered_by_tls_1_2_and_1_3() -> Result {
    let identity = Identity::new()?;
    let service = Service::with(&identity.config()?)?;
    for version in [&TLS12, &TLS13] {
        let mut client = connect(&service, identity.client_of(&[version])?)?;
        assert!(scan(&mut client)?.starts_with("HTTP/1.1 200 "));
        assert_eq!(client.conn.protocol_version(), Some(version.version));
    }
    let stranger = connect(&service, Identity::new()?.client()?)?.write_all(b"GET").err().ok_or("it was trusted")?;
    assert!(stranger.to_string().contains("certificate"), "{stranger}");
    for (offered, chosen) in [(&[&b"h2"[..], b"http/1.1"][..], &b"h2"[..]), (&[b"http/1.1"], b"http/1.1")] {
        let mut config = identity.client()?;
        config.alpn_protocols = offered.iter().map(|name| name.to_vec()).collect();
        let mut client = connect(&service, config)?;
        client.flush()?;
        client.conn.complete_io(&mut client.sock)?;
        assert_eq!(client.conn.alpn_protocol(), Some(chosen));
    }
    Ok(())
}

#[test]
fn who_does_not_shake_hands_is_dropped_and_takes_no_place_from_others() -> Result {
    let identity = Identity::new()?;
    let mut config = identity.config()?;
    config.connections.max = 2;
    config.connections.idle_time = Duration::from_millis(300);
    let service = Service::with(&config)?;
    let silent = service.connect()?;
    let mut plain = service.connect()?;
    plain.write_all(b"GET /info HTTP/1.1\r\nhost: x\r\n\r\n")?;
    let mut said = Vec::new();
    // An alert, then the end, by whichever of the two ways a connection has.
    match plain.read_to_end(&mut said) {
        Err(error) if error.kind() != ErrorKind::ConnectionReset => return Err(error.into()),
        _ => assert!(!said.starts_with(b"HTTP"), "nothing is told without TLS"),
    }
    for mut stream in [silent, service.connect()?] {
        stream.set_read_timeout(Some(Duration::from_mins(2)))?;
        assert_eq!(stream.read(&mut [0])?, 0, "the service ends it");
    }
    wait_until("their places are free", || {
        let answer = connect(&service, identity.client()?).and_then(|mut client| scan(&mut client));
        Ok(answer.is_ok_and(|answer| answer.starts_with("HTTP/1.1 200 ")))
    })
}

#[test]
fn a_client_in_the_middle_of_its_handshake_does_not_keep_the_service_from_stopping() -> Result {
    let identity = Identity::new()?;
    let mut config = identity.config()?;
    config.connections.idle_time = Duration::from_hours(1);
    config.stop.grace = Duration::from_hours(1);
    let service = Service::with(&config)?;
    let _silent = service.connect()?;
    Ok(service.server.stop()?)
}

#[test]
fn a_certificate_that_cannot_be_used_is_named_with_what_is_wrong() -> Result {
    let (identity, other) = (Identity::new()?, Identity::new()?);
    let (good, others) = (identity.files(), other.files());
    let write = |name: &str, text: &str| -> Result<_> {
        let path = identity.0.path().join(name);
        fs::write(&path, text)?;
        Ok(path)
    };
    let refused = |cert: &Path, key: &Path, words: &str| -> Result {
        let tls = Some(TlsFiles { cert: cert.into(), key: key.into() });
        let error = serve(&Config { tls, ..config()? }).err().ok_or("it started")?.to_string();
        assert!(error.starts_with("TLS file ") && error.contains(words), "`{error}` has no `{words}`");
        Ok(())
    };
    refused(&good.cert, &others.key, "key.pem: not the key of the first certificate of ")?;
    refused(&good.cert, &good.cert, "cert.pem: no `-----BEGIN PRIVATE KEY-----` in it")?;
    refused(&good.key, &good.key, "key.pem: no `-----BEGIN CERTIFICATE-----` in it")?;
    refused(&write("text", "a certificate")?, &good.key, "text: no `-----BEGIN CERTIFICATE-----` in it")?;
    refused(&identity.0.path().join("none"), &good.key, "none: No such file")?;
    let half = fs::read_to_string(&good.key)?;
    refused(&good.cert, &write("half", &half[..half.len() / 2])?, "half: not PEM: ")?;
    let odd = "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n";
    refused(&write("odd", odd)?, &good.key, "odd: invalid peer certificate")?;
    let odd = odd.replace("CERTIFICATE", "PRIVATE KEY");
    refused(&good.cert, &write("odd", &odd)?, "odd: ")
}
