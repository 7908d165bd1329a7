//! Canaries: a version that a share of the streams gets before all do.

use std::collections::BTreeMap;
use std::str::FromStr;

use sha2::{Digest, Sha256};
use thiserror::Error;

use crate::repository::is_name;

/// A version for a share of a model's streams; the others get the newest of its other versions.
#[derive(Clone, Debug, PartialEq)]
pub struct Canary {
    /// The model.
    pub model: String,
    /// The version.
    pub version: u64,
    /// Share of the streams, 0–1.
    pub share: f64,
}

/// The canaries of all models, one each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Canaries(BTreeMap<String, Canary>);

/// A canary that cannot be.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum CanaryError {
    /// Its text is none.
    #[error("expected NAME=VERSION:SHARE with a share from 0 to 1, as in hdl64e=2:0.1")]
    Form,
    /// A model has two.
    #[error("model `{0}` has two canaries")]
    Twice(String),
}

impl FromStr for Canary {
    type Err = CanaryError;

    fn from_str(text: &str) -> Result<Self, CanaryError> {
        let parse = || {
            let (model, rest) = text.split_once('=').filter(|(model, _)| is_name(model))?;
            let (version, share) = rest.split_once(':')?;
            let share = share.parse().ok().filter(|share| (0.0..=1.0).contains(share))?;
            Some(Self { model: model.into(), version: version.parse().ok()?, share })
        };
        parse().ok_or(CanaryError::Form)
    }
}

impl Canary {
    /// True for a stream that gets the canary: the same ones on every machine and after every start, and still when the share grows.
    pub(crate) fn takes(&self, stream: &str) -> bool {
        let hash = Sha256::new().chain_update(&self.model).chain_update("\0").chain_update(stream).finalize();
        let first = hash.iter().take(4).fold(0u32, |number, byte| number << 8 | u32::from(*byte));
        f64::from(first) < self.share * 2f64.powi(32)
    }
}

impl Canaries {
    pub(crate) fn new(canaries: &[Canary]) -> Result<Self, CanaryError> {
        let mut by_model = BTreeMap::new();
        for canary in canaries {
            if by_model.insert(canary.model.clone(), canary.clone()).is_some() {
                return Err(CanaryError::Twice(canary.model.clone()));
            }
        }
        Ok(Self(by_model))
    }

    /// The entry of a model's versions for a request that names none, of a stream if it has one.
    pub(crate) fn choose<'v, T>(
        &self,
        model: &str,
        versions: &'v BTreeMap<u64, T>,
        stream: Option<&str>,
    ) -> Option<&'v T> {
        let newest = versions.last_key_value().map(|(_, newest)| newest);
        let Some(canary) = self.0.get(model) else { return newest };
        let taken = versions.get(&canary.version).filter(|_| stream.is_some_and(|stream| canary.takes(stream)));
        let other = || versions.iter().rfind(|(version, _)| **version != canary.version).map(|(_, other)| other);
        taken.or_else(other).or(newest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_canary_is_written_in_one_way() {
        let canary = Canary { model: "hdl64e".into(), version: 2, share: 0.1 };
        assert_eq!("hdl64e=2:0.1".parse(), Ok(canary));
        for wrong in [
            "",
            "hdl64e",
            "hdl64e=2",
            "=2:0.1",
            "hdl64e=x:0.1",
            "hdl64e=2:1.1",
            "hdl64e=2:-0.1",
            "a b=2:0.1",
            "m=1:NaN",
        ] {
            assert_eq!(wrong.parse::<Canary>(), Err(CanaryError::Form), "{wrong}");
        }
    }

    #[test]
    fn a_stream_gets_the_same_version_every_time_and_the_share_is_kept() -> Result<(), CanaryError> {
        let versions = BTreeMap::from([(1, 1), (2, 2), (3, 3)]);
        let streams: Vec<String> = (0..10_000).map(|i| format!("ego-{i}")).collect();
        let takers = |text: &str| -> Result<Vec<&String>, CanaryError> {
            let canaries = Canaries::new(&[text.parse()?])?;
            let of = |stream: &String| canaries.choose("m", &versions, Some(stream)).copied();
            assert!(streams.iter().all(|stream| of(stream) == of(stream) && of(stream) != Some(1)));
            assert_eq!(canaries.choose("m", &versions, None), Some(&2), "whoever has no stream gets what most get");
            assert_eq!(canaries.choose("other", &versions, Some("ego-1")), Some(&3));
            Ok(streams.iter().filter(|stream| of(stream) == Some(3)).collect())
        };
        let (tenth, third) = (takers("m=3:0.1")?, takers("m=3:0.3")?);
        // Five standard deviations of √(n·p·(1−p)) = 30 and 46.
        assert!(
            tenth.len().abs_diff(1000) < 150 && third.len().abs_diff(3000) < 230,
            "{} {}",
            tenth.len(),
            third.len()
        );
        assert!(
            tenth.iter().all(|stream| third.contains(stream)),
            "a larger share takes more streams, and keeps those it had"
        );
        assert_eq!((takers("m=3:0")?.len(), takers("m=3:1")?.len()), (0, 10_000));
        assert_eq!(Canaries::new(&["m=4:1".parse()?])?.choose("m", &versions, Some("ego")), Some(&3), "there is no 4");
        assert_eq!(Canaries::new(&["m=4:1".parse()?, "m=3:1".parse()?]).err(), Some(CanaryError::Twice("m".into())));
        Ok(())
    }
}
