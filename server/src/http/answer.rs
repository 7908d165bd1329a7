//! The answer to a scan: its bytes, and headers that say what was done to it.

use axum::body::{Body, Bytes};
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::Response;

use super::scan::Wish;
use crate::budget::Share;
use crate::pipeline::ScanAnswer;

/// The answer with its headers:
///
/// | header | meaning |
/// |---|---|
/// | `x-realbeam-seed` | the seed used |
/// | `x-realbeam-model`, `-model-version`, `-model-digest` | the model, and the SHA-256 of its file |
/// | `x-realbeam-points-in` | points of the scan; the sum of the next five |
/// | `x-realbeam-points-kept` | points of the scan that are in the answer |
/// | `x-realbeam-points-dropped` | points whose ray the sensor does not report |
/// | `x-realbeam-points-lost` | points behind a nearer one of the same ray |
/// | `x-realbeam-points-invalid` | points that are NaN, infinite, or at the origin |
/// | `x-realbeam-points-out-of-range` | points out of the sensor's range or view |
/// | `x-realbeam-points-added` | points of the answer on rays where the scan has none; they follow the others |
/// | `x-realbeam-grid-coverage` | share of the model's rings that have a point |
/// | `x-realbeam-warning` | what to change if the scan does not fit the model's sensor |
/// | `Server-Timing` | milliseconds a stage |
pub(crate) fn response(answer: ScanAnswer, share: Share, wish: &Wish) -> Response {
    let numbers = [
        ("x-realbeam-seed", wish.seed),
        ("x-realbeam-model-version", wish.offer.version),
        ("x-realbeam-points-in", answer.fit.report.points_in as u64),
        ("x-realbeam-points-kept", answer.fit.kept as u64),
        ("x-realbeam-points-added", answer.fit.added as u64),
        ("x-realbeam-points-dropped", answer.fit.dropped() as u64),
        ("x-realbeam-points-lost", answer.fit.report.lost as u64),
        ("x-realbeam-points-invalid", answer.fit.invalid() as u64),
        ("x-realbeam-points-out-of-range", answer.fit.out_of_range() as u64),
    ];
    let texts = [
        ("x-realbeam-model", Some(wish.offer.model.name.clone())),
        ("x-realbeam-model-digest", Some(format!("sha256:{}", wish.offer.model.digest))),
        ("x-realbeam-grid-coverage", Some(format!("{:.4}", answer.fit.coverage.rings))),
        ("x-realbeam-warning", answer.fit.warning),
        ("server-timing", Some(answer.times.to_string())),
    ];
    let mut response = Response::new(Body::from(on_its_way(answer.bytes, share)));
    // For whoever traces requests.
    response.extensions_mut().insert(answer.times);
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(wish.accepted.name));
    for (name, number) in numbers {
        headers.insert(HeaderName::from_static(name), number.into());
    }
    for (name, text) in texts {
        // All of these are plain ASCII: a model's name by the rules of the repository, the rest by how they are made.
        if let Some(value) = text.and_then(|text| HeaderValue::try_from(text).ok()) {
            headers.insert(HeaderName::from_static(name), value);
        }
    }
    response
}

/// Bytes that count as under way until the connection has let go of the last of them.
pub(super) fn on_its_way(bytes: Vec<u8>, mut share: Share) -> Bytes {
    struct Held {
        bytes: Vec<u8>,
        _share: Share,
    }
    impl AsRef<[u8]> for Held {
        fn as_ref(&self) -> &[u8] {
            &self.bytes
        }
    }
    share.resize(bytes.len());
    Bytes::from_owner(Held { bytes, _share: share })
}
