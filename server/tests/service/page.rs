//! The page for people, as a browser gets it. What it does there is `scripts/look_at_page.py`'s matter.

use std::collections::HashSet;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use lidar::formats::{self, Format, Limits};
use proto::ErrorCode;
use server::Config;
use sha2::{Digest, Sha256};

use crate::errors::assert_error;
use crate::support::{COLUMNS, RINGS, Result, Service, config};

/// What lies between two marks.
fn between<'t>(text: &'t str, from: &str, to: &str) -> Result<&'t str> {
    let (_, rest) = text.split_once(from).ok_or("no beginning")?;
    Ok(rest.split_once(to).ok_or("no end")?.0)
}

#[test]
fn the_page_is_one_file_that_runs_its_own_script_and_nothing_else() -> Result {
    let answer = Service::start()?.get("/")?;
    assert_eq!(answer.header("content-type"), "text/html; charset=utf-8");
    let policy = answer.header("content-security-policy").to_owned();
    for header in ["cross-origin-resource-policy", "cross-origin-opener-policy"] {
        assert_eq!(answer.header(header), "same-origin");
    }
    assert_eq!((answer.header("x-content-type-options"), answer.header("x-frame-options")), ("nosniff", "DENY"));
    assert_eq!(answer.header("access-control-allow-origin"), "");
    let html = String::from_utf8(answer.success()?)?;
    for (kind, text) in [
        ("script", between(&html, "<script type=\"module\">", "</script>")?),
        ("style", between(&html, "<style>", "</style>")?),
    ] {
        let source = format!("{kind}-src 'sha256-{}';", STANDARD.encode(Sha256::digest(text)));
        assert!(policy.contains(&source), "{policy}");
    }
    assert!(policy.starts_with("default-src 'none';") && !policy.contains("unsafe"), "{policy}");
    for elsewhere in ["src=", "url(", "@import", " style=", "{{"] {
        assert!(!html.contains(elsewhere), "{elsewhere}");
    }
    assert!(html.contains("\"traffic-sign\""), "classes have names");
    Ok(())
}

#[test]
fn a_sample_fits_the_model_that_it_is_asked_for() -> Result {
    let service = Service::start()?;
    let sample = |query: &str| -> Result<Vec<u8>> {
        let answer = service.get(&format!("/sample{query}"))?;
        assert_eq!(answer.header("content-type"), "model/x-ply");
        answer.success()
    };
    let (first, other, again) = (sample("")?, sample("?model=hdl64e")?, sample("?model=passthrough")?);
    assert!(first == again && first != other);
    let cloud = formats::decode(Format::Ply, &first, &Limits::default())?;
    assert!(cloud.len() > RINGS * COLUMNS / 2, "{}", cloud.len());
    let labels: HashSet<u32> = cloud.label.iter().flatten().map(|label| label & 0xffff).collect();
    assert!(labels.len() > 4, "{labels:?}");
    let answer = service.scan("?version=1", &[("content-type", "model/x-ply")], &first)?;
    assert_eq!(
        (answer.number("x-realbeam-points-kept")?, answer.header("x-realbeam-warning")),
        (cloud.len() as u64, "")
    );
    assert_error(&service.get("/sample?model=hdl65e")?, 404, ErrorCode::ModelNotFound, "no model `hdl65e`")?;
    assert_error(&service.get("/sample?modell=x")?, 400, ErrorCode::BadQuery, "`modell` is unknown")
}

#[test]
fn who_wants_no_page_has_none() -> Result {
    let service = Service::with(&Config { page: false, ..config()? })?;
    for path in ["/", "/sample"] {
        assert_error(&service.get(path)?, 404, ErrorCode::RouteNotFound, "no such route")?;
    }
    assert_eq!(service.get("/info")?.status, 200);
    Ok(())
}
