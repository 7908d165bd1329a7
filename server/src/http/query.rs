//! The query of `POST /v1/scan`.

use axum::extract::Query;
use axum::http::Uri;
use lidar::label::CarlaTags;
use proto::{ErrorCode, Frame};

use super::error::ApiError;
use crate::generator::Noise;

/// What the query says; nothing in it is obligatory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct ScanQuery {
    pub(crate) model: Option<String>,
    pub(crate) version: Option<u64>,
    pub(crate) seed: Option<u64>,
    pub(crate) noise: Noise,
    /// `None` leaves the frame to the body's type.
    pub(crate) frame: Option<Frame>,
    /// `None` means CARLA's newest table.
    pub(crate) tags: Option<CarlaTags>,
}

/// The pairs of a query.
pub(super) fn pairs(uri: &Uri) -> Result<Vec<(String, String)>, ApiError> {
    let pairs = Query::try_from_uri(uri).map_err(|error| ApiError::new(ErrorCode::BadQuery, error.body_text()))?;
    Ok(pairs.0)
}

/// Keys that a query may have.
const KEYS: [&str; 6] = ["model", "version", "seed", "noise", "frame", "tags"];

impl ScanQuery {
    /// Reads the query's pairs; a key that is unknown or comes twice is an error, so that no misspelt wish is silently ignored.
    pub(crate) fn parse(pairs: &[(String, String)]) -> Result<Self, ApiError> {
        let bad = |message: String| ApiError::new(ErrorCode::BadQuery, message);
        let mut query = Self::default();
        for (i, (key, value)) in pairs.iter().enumerate() {
            if pairs[..i].iter().any(|(earlier, _)| earlier == key) {
                return Err(bad(format!("query key `{key}` is given twice")));
            }
            let wrong = |expected: &str| bad(format!("query key `{key}` is `{value}`, expected {expected}"));
            match key.as_str() {
                "model" => query.model = Some(value.clone()),
                "version" if value == "latest" => query.version = None,
                "version" => query.version = Some(value.parse().map_err(|_| wrong("a whole number or latest"))?),
                "seed" => query.seed = Some(value.parse().map_err(|_| wrong("a whole number from 0 to 2^64 - 1"))?),
                "noise" => query.noise = noise(value).ok_or_else(|| wrong("drawn or median"))?,
                "frame" => query.frame = Some(frame(value).ok_or_else(|| wrong("carla or ros"))?),
                "tags" => query.tags = Some(tags(value).ok_or_else(|| wrong("0.9.13 or 0.9.14"))?),
                _ => return Err(bad(format!("query key `{key}` is unknown; there are {}", KEYS.join(", ")))),
            }
        }
        Ok(query)
    }
}

fn noise(value: &str) -> Option<Noise> {
    match value {
        "drawn" => Some(Noise::Drawn),
        "median" => Some(Noise::Median),
        _ => None,
    }
}

fn frame(value: &str) -> Option<Frame> {
    match value {
        "carla" => Some(Frame::Carla),
        "ros" => Some(Frame::Ros),
        _ => None,
    }
}

fn tags(value: &str) -> Option<CarlaTags> {
    match value {
        "0.9.13" => Some(CarlaTags::Until0913),
        "0.9.14" => Some(CarlaTags::Since0914),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(pairs: &[(&str, &str)]) -> Result<ScanQuery, String> {
        let pairs: Vec<_> = pairs.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        ScanQuery::parse(&pairs).map_err(|error| error.message)
    }

    #[test]
    fn everything_is_optional_and_nothing_is_ignored() {
        assert_eq!(parse(&[]), Ok(ScanQuery::default()));
        let all = [
            ("model", "m"),
            ("version", "3"),
            ("seed", "18446744073709551615"),
            ("noise", "median"),
            ("frame", "carla"),
            ("tags", "0.9.13"),
        ];
        let expected = ScanQuery {
            model: Some("m".into()),
            version: Some(3),
            seed: Some(u64::MAX),
            noise: Noise::Median,
            frame: Some(Frame::Carla),
            tags: Some(CarlaTags::Until0913),
        };
        assert_eq!(parse(&all), Ok(expected));
        let message = |pairs| parse(pairs).err().unwrap_or_default();
        assert_eq!(
            message(&[("sed", "1")]),
            "query key `sed` is unknown; there are model, version, seed, noise, frame, tags"
        );
        assert_eq!(message(&[("seed", "1"), ("seed", "1")]), "query key `seed` is given twice");
        assert_eq!(message(&[("seed", "-1")]), "query key `seed` is `-1`, expected a whole number from 0 to 2^64 - 1");
        assert_eq!(message(&[("noise", "none")]), "query key `noise` is `none`, expected drawn or median");
        assert_eq!(message(&[("frame", "left")]), "query key `frame` is `left`, expected carla or ros");
    }
}
