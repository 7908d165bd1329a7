//! A service on a Unix-domain socket.
#![cfg(unix)]

use std::fs;
use std::io::{Read, Write};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;

use server::{Address, Config, serve};

use crate::support::{Result, bin, config, wait_until};

fn at(path: &Path) -> Result<Config> {
    Ok(Config { addr: Address::Unix(path.into()), ..config()? })
}

/// The answer to a request with a body, head and all.
fn ask(path: &Path, request: &str, body: &[u8]) -> Result<String> {
    let mut stream = UnixStream::connect(path)?;
    write!(stream, "{request} HTTP/1.1\r\nhost: x\r\nconnection: close\r\ncontent-length: {}\r\n\r\n", body.len())?;
    stream.write_all(body)?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    Ok(String::from_utf8_lossy(&answer).into_owned())
}

fn why_not(config: &Config) -> Result<String> {
    Ok(serve(config).err().ok_or("it started")?.to_string())
}

#[test]
fn a_scan_is_answered_over_a_socket_that_its_owner_alone_may_use() -> Result {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("scan.sock");
    let server = serve(&at(&path)?)?;
    assert_eq!(server.addr(), &Address::Unix(path.clone()));
    let file = fs::symlink_metadata(&path)?;
    assert!(file.file_type().is_socket());
    assert_eq!(file.permissions().mode() & 0o777, 0o600);
    assert!(ask(&path, "POST /v1/scan", &bin()?)?.starts_with("HTTP/1.1 200 "));
    server.stop()?;
    assert_eq!(fs::read_dir(folder.path())?.count(), 0, "nothing is left");
    Ok(())
}

#[test]
fn a_dead_server_s_socket_is_replaced_and_nothing_else() -> Result {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("scan.sock");
    drop(UnixListener::bind(&path)?);
    let server = serve(&Config { socket_mode: 0o660, ..at(&path)? })?;
    assert_eq!(fs::symlink_metadata(&path)?.permissions().mode() & 0o777, 0o660);
    let refused = why_not(&at(&path)?)?;
    assert_eq!(refused, format!("cannot listen at unix:{}: another server listens there", path.display()));
    assert!(ask(&path, "GET /v2/health/live", &[])?.starts_with("HTTP/1.1 200 "), "it still does");

    // Whoever removed the file and put his own there keeps it.
    fs::remove_file(&path)?;
    fs::write(&path, "mine")?;
    assert!(why_not(&at(&path)?)?.ends_with("there is a file that is no socket"));
    server.stop()?;
    assert_eq!(fs::read_to_string(&path)?, "mine");

    let other = folder.path().join("other.sock");
    fs::create_dir(folder.path().join("other.sock.new"))?;
    assert!(why_not(&at(&other)?)?.contains("other.sock.new is there already: another server is starting"));
    assert!(why_not(&at(Path::new("/no/such/folder/scan.sock"))?)?.contains("/no/such/folder/scan.sock"));
    Ok(())
}

#[test]
fn one_connection_too_many_is_told_so_there_too() -> Result {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("scan.sock");
    let mut config = at(&path)?;
    config.connections.max = 1;
    let _server = serve(&config)?;
    let place = UnixStream::connect(&path)?;
    let mut answer = String::new();
    UnixStream::connect(&path)?.read_to_string(&mut answer)?;
    assert!(answer.starts_with("HTTP/1.1 503 ") && answer.contains("too_many_connections"), "{answer}");
    drop(place);
    wait_until("the place is free and the refusal counted", || {
        let metrics = ask(&path, "GET /metrics", &[])?;
        let refused = metrics.lines().find_map(|line| line.strip_prefix("realbeam_refused_connections_total "));
        Ok(refused.is_some_and(|refused| refused != "0"))
    })
}
