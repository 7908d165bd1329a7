//! `GET /`: a page on which a person sees what the service makes of a scan. One file to the browser, which gets nothing from elsewhere.

use std::sync::{Arc, LazyLock};

use axum::Router;
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::IntoResponse;
use axum::routing::get;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use lidar::label::CLASS_NAMES;
use sha2::{Digest, Sha256};

use super::App;
use super::sample::Street;

/// The page's routes.
pub(super) fn router() -> Router<Arc<App>> {
    let street = Street::default();
    Router::new().route("/", get(page)).route("/sample", get(move |state, uri| street.sample(state, uri)))
}

/// The page, and the policy that lets its browser run its own script and style, ask this service, and nothing else.
struct Page {
    html: String,
    policy: HeaderValue,
}

async fn page() -> impl IntoResponse {
    static PAGE: LazyLock<Page> = LazyLock::new(Page::assemble);
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8")),
        (header::CONTENT_SECURITY_POLICY, PAGE.policy.clone()),
        (header::CACHE_CONTROL, HeaderValue::from_static("no-cache")),
        (header::REFERRER_POLICY, HeaderValue::from_static("no-referrer")),
        (header::X_FRAME_OPTIONS, HeaderValue::from_static("DENY")),
        (HeaderName::from_static("cross-origin-opener-policy"), HeaderValue::from_static("same-origin")),
    ];
    (headers, SAME_ORIGIN, PAGE.html.as_str())
}

/// Headers by which no other origin may embed an answer, nor a browser guess its type.
pub(super) const SAME_ORIGIN: [(HeaderName, HeaderValue); 2] = [
    (HeaderName::from_static("cross-origin-resource-policy"), HeaderValue::from_static("same-origin")),
    (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
];

impl Page {
    fn assemble() -> Self {
        let style = include_str!("../page/page.css");
        // A list of plain names is JSON.
        let names = serde_json::to_string(&CLASS_NAMES).unwrap_or_default();
        let script = [
            &include_str!("../page/colours.js").replace("{{class_names}}", &names),
            include_str!("../page/scan.js"),
            include_str!("../page/view.js"),
            include_str!("../page/page.js"),
        ]
        .join("\n");
        let hash = |text: &str| STANDARD.encode(Sha256::digest(text));
        let policy = format!(
            "default-src 'none'; script-src 'sha256-{}'; style-src 'sha256-{}'; connect-src 'self'; img-src data:; base-uri 'none'; \
             form-action 'none'; frame-ancestors 'none'",
            hash(&script),
            hash(style)
        );
        let html = include_str!("../page/index.html").replace("{{style}}", style).replace("{{script}}", &script);
        // Plain ASCII by how it is made; without it the browser would run nothing.
        let policy = HeaderValue::try_from(policy).unwrap_or(HeaderValue::from_static("default-src 'none'"));
        Self { html, policy }
    }
}
