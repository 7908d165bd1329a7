//! The Open Inference Protocol, as others speak it, and bodies that only pretend to.

use std::process::Command;

use proto::ErrorCode;
use tempfile::NamedTempFile;

use crate::support::{Result, Service, bin, data, python};

#[test]
fn the_unmodified_tritonclient_gets_everything_that_it_can_ask_for() -> Result {
    let Some(python) = python("tritonclient.http, tritonclient.grpc") else { return Ok(()) };
    let service = Service::start()?;
    let scan = NamedTempFile::new()?;
    std::fs::write(scan.path(), bin()?)?;
    let mut client = Command::new(python);
    client.arg(data().join("tritonclient_conformance.py")).arg(service.server.addr().to_string()).arg(scan.path());
    let output = client.output()?;
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}\n{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(said.trim(), "conforms");
    Ok(())
}

#[test]
fn carlas_buffer_is_a_legal_body_and_comes_back_as_the_scan_route_gives_it() -> Result {
    let service = Service::start()?;
    let body = bin()?;
    let raw = [("inference-header-content-length", "0")];
    let answer = service.post("/v2/models/scan/infer?seed=7", &raw, &body)?;
    let json = answer.number("inference-header-content-length")? as usize;
    let bytes = answer.success()?;
    let head: serde_json::Value = serde_json::from_slice(&bytes[..json])?;
    assert_eq!((&head["model_version"], &head["parameters"]["model"]), (&"2".into(), &"passthrough".into()));
    assert!(bytes[json..] == service.scan("?seed=7", &[], &body)?.success()?);
    let carla = service.post("/v2/models/scan/infer?seed=7&frame=carla", &raw, &body)?;
    let json = carla.number("inference-header-content-length")? as usize;
    assert!(carla.success()?[json..] == service.scan("?seed=7&frame=carla", &[], &body)?.success()?);
    Ok(())
}

#[test]
fn bodies_that_lie_are_refused_with_what_is_wrong() -> Result {
    let service = Service::start()?;
    let infer = |model: &str, header: Option<&str>, body: &[u8]| -> Result<(u16, ErrorCode, String)> {
        let headers: Vec<_> = header.into_iter().map(|length| ("inference-header-content-length", length)).collect();
        let answer = service.post(&format!("/v2/models/{model}/infer"), &headers, body)?;
        let error = answer.error()?;
        Ok((answer.status, error.code, error.error))
    };
    let points = |shape: &str, rest: &str| {
        format!(r#"{{"inputs":[{{"name":"POINTS","shape":{shape},"datatype":"FP32",{rest}}}]}}"#)
    };
    for (header, body, words) in [
        (None, "{".into(), "request: EOF while parsing"),
        (None, "[".repeat(1 << 20), "request: "),
        (Some("99"), "{}".into(), "is 99, but the body has 2 bytes"),
        (Some("18446744073709551615"), "{}".into(), "but the body has 2 bytes"),
        (Some("-1"), "{}".into(), "is `-1`, expected a whole number"),
        (None, points("[-1,4]", r#""data":[1,2,3,4]"#), "shape is [-1, 4], but there are 4 elements"),
        (None, points("[4611686018427387904,4]", r#""data":[]"#), "but there are 0 elements"),
        (None, points("[1,4]", r#""data":[1,2,3,null]"#), "request: invalid type: null"),
        (
            None,
            points("[1,4]", r#""parameters":{"binary_data_size":16}"#),
            "have 16 bytes after the JSON, but there are 0",
        ),
        (None, points("[1,4]", r#""parameters":{"shared_memory_region":"x"}"#), "shared memory is not supported"),
    ] {
        let (status, _, message) = infer("scan", header, body.as_bytes())?;
        assert_eq!(status, 400, "{message}");
        assert!(message.contains(words), "`{message}` has no `{words}`");
    }
    let (status, code, message) = infer("scan", Some("0"), &[0; 17])?;
    assert_eq!((status, code), (400, ErrorCode::MalformedScan), "{message}");
    let (status, code, message) = infer("passthrough", Some("0"), &[0; 16])?;
    assert_eq!((status, code), (400, ErrorCode::MalformedTensors), "{message}");
    let huge = format!(
        r#"{{"inputs":[{}]}}"#,
        vec![r#"{"name":"x","shape":[0],"datatype":"FP32","data":[]}"#; 2000].join(",")
    );
    let (status, code, _) = infer("passthrough", None, huge.as_bytes())?;
    assert_eq!((status, code), (422, ErrorCode::UnusableTensors));
    assert_eq!(infer("scan/versions/x", None, b"{}")?.0, 404);
    assert_eq!(service.get("/v2/models/scan/infer")?.status, 405);
    Ok(())
}
