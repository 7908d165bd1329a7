//! Every way to fail has its status, its code and its words.

use std::io::{Read, Write};
use std::net::Shutdown;

use lidar::PointCloud;
use lidar::formats::{self, Format};
use proto::{ErrorBody, ErrorCode};

use crate::support::{Answer, Result, Service, bin, config, scan};

/// Sends all bytes as they are, then reads until the service closes. A request that breaks off is followed by the end of the stream.
fn raw(service: &Service, request: &[u8], breaks_off: bool) -> Result<(String, ErrorBody)> {
    let mut stream = service.connect()?;
    stream.write_all(request)?;
    if breaks_off {
        stream.shutdown(Shutdown::Write)?;
    }
    let mut text = String::new();
    stream.read_to_string(&mut text)?;
    let (head, body) = text.split_once("\r\n\r\n").ok_or("no head in the answer")?;
    Ok((head.into(), serde_json::from_str(body)?))
}

pub(crate) fn assert_error(answer: &Answer, status: u16, code: ErrorCode, words: &str) -> Result {
    let error = answer.error()?;
    assert_eq!((answer.status, error.code), (status, code), "{}", error.error);
    assert!(error.error.contains(words), "`{}` has no `{words}`", error.error);
    Ok(())
}

#[test]
fn malformed_requests_are_400() -> Result {
    let service = Service::start()?;
    let post = |query: &str, headers: &[(&str, &str)], body: &[u8]| service.scan(query, headers, body);
    assert_error(&post("", &[], &[0; 17])?, 400, ErrorCode::MalformedScan, "17")?;
    assert_error(&post("", &[("content-type", "model/x-ply")], b"plyx")?, 400, ErrorCode::MalformedScan, "scan: ")?;
    assert_error(&post("", &[("content-type", "application/vnd.laz")], b"LASF")?, 400, ErrorCode::MalformedScan, "")?;
    assert_error(&post("?sed=1", &[], &[])?, 400, ErrorCode::BadQuery, "`sed` is unknown")?;
    assert_error(&post("?seed=1&seed=2", &[], &[])?, 400, ErrorCode::BadQuery, "`seed` is given twice")?;
    for seed in ["-1", "1.5", "", "18446744073709551616", "abc"] {
        assert_error(&post(&format!("?seed={seed}"), &[], &[])?, 400, ErrorCode::BadQuery, "`seed` is `")?;
    }
    assert_error(&post("?frame=left", &[], &[])?, 400, ErrorCode::BadQuery, "expected carla or ros")?;
    assert_error(&post("?tags=0.9.12", &[], &[])?, 400, ErrorCode::BadQuery, "expected 0.9.13 or 0.9.14")?;
    assert_error(&post("?version=newest", &[], &[])?, 400, ErrorCode::BadQuery, "expected a whole number")?;
    let (head, error) =
        raw(&service, b"POST /v1/scan HTTP/1.1\r\nhost: x\r\ncontent-length: 160\r\n\r\nhalf a body", true)?;
    assert!(head.starts_with("HTTP/1.1 400"), "{head}");
    assert_eq!(error.code, ErrorCode::BadBody);
    Ok(())
}

#[test]
fn what_is_not_there_is_404_and_another_method_405() -> Result {
    let service = Service::start()?;
    let not_there = |query: &str, words: &str| -> Result {
        assert_error(&service.scan(query, &[], &bin()?)?, 404, ErrorCode::ModelNotFound, words)
    };
    not_there("?model=hdl65e", "no model `hdl65e`; there are: ghosts, hdl64e, passthrough")?;
    not_there("?version=3", "`passthrough` has no version 3; there are: 1, 2")?;
    for name in ["..", "../models/passthrough", "/etc", "%2e%2e%2fpassthrough", ""] {
        not_there(&format!("?model={name}"), "no model `")?;
    }
    assert_error(&service.get("/v2/models/hdl65e")?, 404, ErrorCode::ModelNotFound, "no model `hdl65e`")?;
    for path in ["/index.html", "/v1", "/v1/scan/", "/v2/health", "/etc/passwd"] {
        assert_error(&service.get(path)?, 404, ErrorCode::RouteNotFound, "no such route")?;
    }
    let get = service.get("/v1/scan")?;
    assert_error(&get, 405, ErrorCode::MethodNotAllowed, "method")?;
    assert_eq!(get.header("allow"), "POST");
    Ok(())
}

#[test]
fn unknown_types_are_406_and_415() -> Result {
    let service = Service::start()?;
    let of = |headers: &[(&str, &str)]| service.scan("", headers, &[]);
    assert_error(&of(&[("accept", "image/jpeg")])?, 406, ErrorCode::NotAcceptable, "`image/jpeg`")?;
    assert_error(&of(&[("accept", "*/*;q=0")])?, 406, ErrorCode::NotAcceptable, "")?;
    let form = "application/x-www-form-urlencoded";
    assert_error(&of(&[("content-type", form)])?, 415, ErrorCode::UnsupportedMediaType, form)?;
    assert_error(&of(&[("content-encoding", "gzip")])?, 415, ErrorCode::UnsupportedEncoding, "`gzip`")?;
    of(&[("content-encoding", "identity"), ("accept", "text/html, */*;q=0.1")])?.success()?;
    Ok(())
}

#[test]
fn too_many_bytes_or_points_are_413() -> Result {
    let mut config = config()?;
    (config.requests.max_body_bytes, config.requests.max_points) = (16 * 2000, 1000);
    let service = Service::with(&config)?;
    assert_error(&service.scan("", &[], &vec![0; 32_001])?, 413, ErrorCode::BodyTooLarge, "more than 32000 bytes")?;
    assert_error(&service.scan("", &[], &[0; 16 * 1001])?, 413, ErrorCode::TooManyPoints, "1001")?;
    // A body that announces its length is refused before it is sent, and one that does not as soon as it is too long.
    let (head, error) =
        raw(&service, b"POST /v1/scan HTTP/1.1\r\nhost: x\r\ncontent-length: 99999999999\r\n\r\n", true)?;
    assert!(head.starts_with("HTTP/1.1 413"), "{head}");
    assert_eq!(error.code, ErrorCode::BodyTooLarge);
    let mut chunked = b"POST /v1/scan HTTP/1.1\r\nhost: x\r\ntransfer-encoding: chunked\r\n\r\n".to_vec();
    for _ in 0..33 {
        chunked.extend_from_slice(b"3e8\r\n");
        chunked.extend_from_slice(&[0; 1000]);
        chunked.extend_from_slice(b"\r\n");
    }
    let (head, error) = raw(&service, &chunked, true)?;
    assert!(head.starts_with("HTTP/1.1 413"), "{head}");
    assert_eq!(error.code, ErrorCode::BodyTooLarge);
    Ok(())
}

#[test]
fn a_scan_that_unpacks_to_too_much_is_413() -> Result {
    let (packed, plain) = (formats::encode(Format::Laz, &scan())?, formats::encode(Format::Las, &scan())?);
    let mut config = config()?;
    config.requests.max_unpacked_bytes = 2 * packed.len();
    assert!(config.requests.max_unpacked_bytes < plain.len());
    let service = Service::with(&config)?;
    let headers = [("content-type", "application/vnd.laz")];
    assert_error(&service.scan("", &headers, &packed)?, 413, ErrorCode::TooManyPoints, "bytes")?;
    config.requests.max_unpacked_bytes = plain.len();
    Service::with(&config)?.scan("", &headers, &packed)?.success()?;
    Ok(())
}

#[test]
fn a_refusal_reaches_a_client_that_sends_its_whole_scan_first() -> Result {
    let service = Service::start()?;
    // More than fits into the sockets' buffers, so that the client is still sending when it is refused.
    let body = vec![0; 16 << 20];
    for (query, code) in
        [("?sed=1", ErrorCode::BadQuery), ("?model=x", ErrorCode::ModelNotFound), ("", ErrorCode::BodyTooLarge)]
    {
        let head = format!(
            "POST /v1/scan{query} HTTP/1.1\r\nhost: x\r\nconnection: close\r\ncontent-length: {}\r\n\r\n",
            body.len()
        );
        let (_, error) = raw(&service, &[head.as_bytes(), &body].concat(), false)?;
        assert_eq!(error.code, code);
    }
    Ok(())
}

#[test]
fn well_formed_scans_that_are_no_use_are_422() -> Result {
    let service = Service::start()?;
    let mut cloud = scan();
    cloud.x.fill(f32::NAN);
    let body = formats::encode(Format::Kitti, &cloud)?;
    assert_error(&service.scan("", &[], &body)?, 422, ErrorCode::UnusableScan, "5760 of 5760 points are NaN")?;
    let flat = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n";
    let answer = service.scan("", &[("content-type", "model/x-ply")], flat)?;
    assert_error(&answer, 422, ErrorCode::UnusableScan, "no field `z`")?;
    Ok(())
}

#[test]
fn a_model_that_gives_nan_is_500_and_says_so() -> Result {
    let service = Service::misbehaved()?;
    let answer = service.scan("?model=nan&version=1", &[], &bin()?)?;
    assert_error(&answer, 500, ErrorCode::ModelFailed, "the model gave NaN for 5760 of 5760 rays")?;
    // Rays without a return are the model's to fill with anything, unless it says that it adds returns.
    let empty = formats::encode(Format::Kitti, &PointCloud::new(1.0))?;
    service.scan("?model=nan&version=1", &[], &empty)?.success()?;
    let answer = service.scan("?model=nan&version=2", &[], &empty)?;
    assert_error(&answer, 500, ErrorCode::ModelFailed, "the model gave NaN for 5760 of 5760 rays")?;
    Ok(())
}

#[test]
fn a_client_cannot_put_anything_but_a_plain_id_into_headers_and_logs() -> Result {
    let service = Service::start()?;
    for id in ["a b", "x".repeat(129).as_str()] {
        let answer = service.scan("?sed=1", &[("x-request-id", id)], &[])?;
        assert_ne!(answer.error()?.request_id, id);
    }
    let (first, second) = (service.get("/info")?, service.get("/info")?);
    assert_ne!(first.header("x-request-id"), second.header("x-request-id"));
    Ok(())
}
