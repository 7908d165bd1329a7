//! `GET /docs`: the same document as a page, without a script.

use std::fmt::Write as _;
use std::sync::LazyLock;

use axum::http::{HeaderValue, header};
use axum::response::{Html, IntoResponse};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::openapi::DOCUMENT;
use super::page::SAME_ORIGIN;

const STYLE: &str = include_str!("../page/docs.css");

/// The page.
pub(super) async fn docs() -> impl IntoResponse {
    static PAGE: LazyLock<String> = LazyLock::new(|| page(&DOCUMENT));
    let policy = format!(
        "default-src 'none'; style-src 'sha256-{}'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
        STANDARD.encode(Sha256::digest(STYLE))
    );
    // Plain ASCII by how it is made.
    let policy = HeaderValue::try_from(policy).unwrap_or(HeaderValue::from_static("default-src 'none'"));
    ([(header::CONTENT_SECURITY_POLICY, policy)], SAME_ORIGIN, Html(PAGE.as_str()))
}

fn page(document: &Value) -> String {
    let mut body = String::new();
    for (path, operations) in document["paths"].as_object().into_iter().flatten() {
        for (method, operation) in operations.as_object().into_iter().flatten() {
            section(&mut body, &method.to_uppercase(), path, operation);
        }
    }
    let says = text(&document["info"]["description"]);
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>Realbeam: routes</title><style>{STYLE}</style><main><h1>Realbeam</h1>\
         <p>{says} <a href=\"/api-doc/openapi.json\">As OpenAPI</a></p>{body}</main></html>"
    )
}

// Writing into a string cannot fail.
fn section(out: &mut String, method: &str, path: &str, operation: &Value) {
    let _ = write!(out, "<section><h2><b>{method}</b> {}</h2><p>{}</p>", escaped(path), text(&operation["summary"]));
    let parameters = operation["parameters"].as_array();
    if let Some(parameters) = parameters.filter(|parameters| !parameters.is_empty()) {
        *out += "<table>";
        for p in parameters {
            let (name, place, says) = (text(&p["name"]), text(&p["in"]), text(&p["description"]));
            let _ = write!(out, "<tr><td><code>{name}</code><td>{place}<td>{says}");
        }
        *out += "</table>";
    }
    for (title, content) in
        [("Takes", &operation["requestBody"]["content"]), ("Gives", &operation["responses"]["200"]["content"])]
    {
        if let Some(content) = content.as_object() {
            let types: Vec<String> = content.keys().map(|kind| format!("<code>{}</code>", escaped(kind))).collect();
            let _ = write!(out, "<p><i>{title}</i> {}</p>", types.join(" "));
        }
    }
    *out += "<table>";
    let refusals = operation["responses"].as_object().into_iter().flatten().filter(|(status, _)| *status != "200");
    for (status, response) in refusals {
        let codes = text(&response["description"]).replace('`', "");
        let _ = write!(out, "<tr><td><code>{status}</code><td>{codes}");
    }
    *out += "</table></section>";
}

fn text(value: &Value) -> String {
    escaped(value.as_str().unwrap_or_default())
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}
