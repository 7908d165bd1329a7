//! Ray drop in bursts: neighbours along a ring that are lost together more often than their probabilities say.

use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Bursts of one typical length.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Burst {
    /// Share of the rays that are in such bursts, 0–1.
    pub share: f64,
    /// Distance along the ring, in degrees of azimuth, after which e⁻¹ of them still are in the same one.
    pub azimuth_deg: f64,
}

/// How a sensor's lost rays hang together along its rings.
///
/// A model says of each ray how likely it is to be reported, and a uniform number u decides. Along a ring rays share their u in stretches: two
/// that lie Δ apart have the same one with probability
///
/// > ρ(Δ) = Σ shareᵢ · exp(−Δ / azimuthᵢ),
///
/// and independent ones otherwise. Each ray is lost as often as before, and two with the probabilities p and q of being lost are both lost
/// with ρ · min(p, q) + (1 − ρ) · p · q. Without bursts every ray has a u of its own.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Burst>", into = "Vec<Burst>")]
pub struct Bursts(Vec<Burst>);

/// Bursts that cannot be.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum BurstsError {
    /// A number out of bounds.
    #[error("bursts of lost rays: {field} is {found}, expected {expected}")]
    OutOfBounds {
        /// What it is of.
        field: &'static str,
        /// What it is.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// More lengths than [`MAX_BURSTS`].
    #[error("bursts of lost rays: {0} lengths, expected at most {MAX_BURSTS}")]
    TooMany(usize),
}

/// Most lengths that bursts may have.
pub const MAX_BURSTS: usize = 8;

/// Shares may add up to this much more than 1: they are written in decimals.
const ROUNDING: f64 = 1e-6;

/// Stretches of one kind, in which a ray's number is the next one's as well with probability `goes_on`.
#[derive(Clone, Copy, Debug)]
struct Kind {
    goes_on: f32,
    /// Share of the rays that are in such stretches, added up to this kind.
    rays_up_to: f32,
    /// Share of the stretches that are such, added up to this kind.
    stretches_up_to: f32,
}

impl Bursts {
    /// Checks bursts.
    pub fn new(bursts: Vec<Burst>) -> Result<Self, BurstsError> {
        if bursts.len() > MAX_BURSTS {
            return Err(BurstsError::TooMany(bursts.len()));
        }
        let within = |field, found: f64, most: f64, expected| {
            let ok = found > 0.0 && found <= most;
            if ok { Ok(()) } else { Err(BurstsError::OutOfBounds { field, found, expected }) }
        };
        for burst in &bursts {
            within("share", burst.share, 1.0, "more than 0 and at most 1")?;
            within("azimuth_deg", burst.azimuth_deg, 360.0, "more than 0 and at most 360")?;
        }
        let sum: f64 = bursts.iter().map(|burst| burst.share).sum();
        if !bursts.is_empty() {
            within("the sum of the shares", sum, 1.0 + ROUNDING, "at most 1")?;
        }
        Ok(Self(bursts))
    }

    /// Whether every ray is lost or not for itself.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The lengths and their shares.
    pub fn as_slice(&self) -> &[Burst] {
        &self.0
    }

    /// ρ: the probability that two rays of a ring, so far apart, share their number.
    pub fn together(&self, azimuth_deg: f64) -> f64 {
        self.0.iter().map(|burst| burst.share * (-azimuth_deg / burst.azimuth_deg).exp()).sum()
    }

    /// Lets rays take over the `numbers` of those before them along their ring. `range_m`, `draws` and `numbers` are `[ring, column]`; `draws`
    /// decide, independent and uniform. Rays without a return keep their own number, and interrupt no burst.
    pub(super) fn share(&self, columns: usize, column_deg: f64, range_m: &[f32], draws: &[f32], numbers: &mut [f32]) {
        let kinds = self.kinds(column_deg);
        let rows = range_m.chunks(columns.max(1)).zip(draws.chunks(columns.max(1)));
        for ((range_m, draws), numbers) in rows.zip(numbers.chunks_mut(columns.max(1))) {
            let (mut kind, mut shared) = (None::<Kind>, 0.0);
            for ((&range_m, &draw), number) in range_m.iter().zip(draws).zip(numbers) {
                match kind {
                    Some(Kind { goes_on, .. }) if draw < goes_on => {}
                    // What is left of the draw is uniform again, and chooses what begins here: a turn in the middle of what is most of it.
                    Some(Kind { goes_on, .. }) => {
                        let left = (draw - goes_on) / (1.0 - goes_on);
                        (kind, shared) = (first(&kinds, |kind| left < kind.stretches_up_to), *number);
                    }
                    None => (kind, shared) = (first(&kinds, |kind| draw < kind.rays_up_to), *number),
                }
                if range_m > 0.0 {
                    *number = shared;
                }
            }
        }
    }

    /// The kinds of stretches at a spacing of columns; the last are single rays. A kind's stretches are as many as its rays, divided by
    /// the rays of one: 1 / (1 − `goes_on`).
    fn kinds(&self, column_deg: f64) -> Vec<Kind> {
        let alone = (1.0 - self.together(0.0)).max(0.0);
        let goes_on = |burst: &Burst| (-column_deg / burst.azimuth_deg).exp();
        let pairs: Vec<(f64, f64)> =
            self.0.iter().map(|burst| (burst.share, goes_on(burst))).chain([(alone, 0.0)]).collect();
        let stretches: f64 = pairs.iter().map(|(share, goes_on)| share * (1.0 - goes_on)).sum();
        let (mut rays_up_to, mut stretches_up_to) = (0.0, 0.0);
        let kind = |(share, goes_on): (f64, f64)| {
            rays_up_to += share;
            stretches_up_to += share * (1.0 - goes_on) / stretches;
            Kind { goes_on: goes_on as f32, rays_up_to: rays_up_to as f32, stretches_up_to: stretches_up_to as f32 }
        };
        pairs.into_iter().map(kind).collect()
    }
}

/// The first kind that is meant, or the last: sums of shares may be a rounding short of 1.
fn first(kinds: &[Kind], is: impl Fn(&Kind) -> bool) -> Option<Kind> {
    kinds.iter().find(|kind| is(kind)).or(kinds.last()).copied()
}

impl fmt::Display for Burst {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of the rays in bursts of {}°", self.share, self.azimuth_deg)
    }
}

impl TryFrom<Vec<Burst>> for Bursts {
    type Error = BurstsError;

    fn try_from(bursts: Vec<Burst>) -> Result<Self, BurstsError> {
        Self::new(bursts)
    }
}

impl From<Bursts> for Vec<Burst> {
    fn from(bursts: Bursts) -> Self {
        bursts.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_that_cannot_be_are_refused_by_name() {
        let burst = |share, azimuth_deg| Burst { share, azimuth_deg };
        for (bursts, expected) in [
            (vec![burst(0.0, 1.0)], "share is 0"),
            (vec![burst(f64::NAN, 1.0)], "share is NaN"),
            (vec![burst(0.5, -1.0)], "azimuth_deg is -1"),
            (vec![burst(0.5, f64::INFINITY)], "azimuth_deg is inf"),
            (vec![burst(0.6, 1.0), burst(0.6, 2.0)], "the sum of the shares is 1.2"),
            (vec![burst(0.1, 1.0); 9], "9 lengths"),
        ] {
            let error = Bursts::new(bursts).map_err(|error| error.to_string());
            assert!(error.as_ref().is_err_and(|error| error.contains(expected)), "{error:?}");
        }
    }

    #[test]
    fn a_file_of_runs_is_checked_as_well() {
        let read = |text: &str| serde_json::from_str::<Bursts>(text).map_err(|error| error.to_string());
        assert_eq!(
            read(r#"[{"share":0.25,"azimuth_deg":2.0}]"#).map(|bursts| bursts.together(2.0)),
            Ok(0.25 * (-1f64).exp())
        );
        assert!(read(r#"[{"share":2,"azimuth_deg":2.0}]"#).is_err_and(|error| error.contains("share is 2")));
        assert!(read(r#"[{"share":0.2,"azimuth_deg":2.0,"rings":1}]"#).is_err());
    }
}
