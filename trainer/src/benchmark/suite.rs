//! Which sets the loop is run on.

use hidden::{LIBRARY, UNKNOWN};
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::case::Case;

/// A question put to the loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Suite {
    /// One defect of the library at its typical size.
    Single,
    /// Two of them.
    Pairs,
    /// One that the library does not have.
    Unknown,
    /// None.
    Nothing,
    /// One at sizes from 1/128 of the typical to twice.
    Size,
}

/// What of the benchmark to run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selection {
    /// The suites.
    pub suites: Vec<Suite>,
    /// Sets for each name, pair, or name and size; of `nothing`, [`NOTHINGS`] times as many.
    pub seeds: u64,
    /// Sets with this defect alone.
    pub only: Option<String>,
}

/// Sets without a defect for each seed: a false alarm in twenty has to show.
pub const NOTHINGS: u64 = 20;

/// Random pairs for each seed.
const RANDOM_PAIRS: u64 = 8;

/// Pairs whose traces resemble one another.
const CONFUSED: &[[&str; 2]] = &[
    ["elevation_offset", "mount_pitch"],
    ["elevation_offset", "mount_roll"],
    ["range_offset", "range_scale"],
    ["range_offset", "range_walk"],
    ["range_scale", "range_walk"],
    ["incidence_stretch", "elevation_offset"],
    ["ring_gain", "reflectance_falloff"],
    ["reflectance_falloff", "fog"],
    ["weak_return_drop", "fog"],
    ["weak_return_drop", "specular"],
    ["fog", "specular"],
    ["blocked_sector", "encoder_eccentricity"],
    ["blocked_sector", "rolling_shutter"],
];

/// Pairs of which the second can do whatever the first does: no data tell them apart, so they are no question.
const NESTED: &[[&str; 2]] = &[
    ["elevation_offset", "elevation_offset_per_ring"],
    ["mount_yaw", "azimuth_offset_per_ring"],
    ["range_offset", "range_offset_per_ring"],
];

/// Defects whose detection is measured against their size: of every channel, of one number and of many.
const SIZED: &[&str] = &[
    "elevation_offset",
    "mount_pitch",
    "range_offset_per_ring",
    "range_walk",
    "ring_gain",
    "incidence_falloff",
    "weak_return_drop",
    "random_returns",
];

/// Sizes, as powers of two.
const SIZES_LOG2: std::ops::RangeInclusive<i32> = -7..=1;

impl Suite {
    /// Every suite.
    pub const ALL: [Self; 5] = [Self::Single, Self::Pairs, Self::Unknown, Self::Nothing, Self::Size];

    /// Its name, as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::Pairs => "pairs",
            Self::Unknown => "unknown",
            Self::Nothing => "nothing",
            Self::Size => "size",
        }
    }

    /// The sets of round `seed`.
    fn round(self, seed: u64) -> Vec<Case> {
        let case = |names: &[&str], size: f64, number: u64| Case {
            suite: self,
            names: names.iter().map(|name| (*name).to_owned()).collect(),
            size,
            number,
        };
        let each = |names: &[&str]| names.iter().map(|name| case(&[name], 1.0, seed)).collect::<Vec<_>>();
        match self {
            Self::Single => each(LIBRARY),
            Self::Unknown => each(UNKNOWN),
            Self::Nothing => (0..NOTHINGS).map(|k| case(&[], 1.0, seed * NOTHINGS + k)).collect(),
            Self::Pairs => {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                let random = (0..RANDOM_PAIRS).map(|_| random_pair(&mut rng)).collect::<Vec<_>>();
                CONFUSED.iter().chain(&random).map(|pair| case(pair, 1.0, seed)).collect()
            }
            Self::Size => {
                let of = |name: &&str| {
                    SIZES_LOG2.map(|log2| case(&[name], f64::from(log2).exp2(), seed)).collect::<Vec<_>>()
                };
                SIZED.iter().flat_map(of).collect()
            }
        }
    }
}

fn random_pair(rng: &mut ChaCha8Rng) -> [&'static str; 2] {
    loop {
        let first = LIBRARY[rng.random_range(0..LIBRARY.len())];
        let Some(second) = LIBRARY.choose(rng) else { continue };
        let (pair, turned) = ([first, *second], [*second, first]);
        if first != *second && !NESTED.iter().any(|nested| *nested == pair || *nested == turned) {
            return pair;
        }
    }
}

impl Selection {
    /// The sets, round by round: a run that stops early has asked every question about as often.
    pub fn cases(&self) -> Vec<Case> {
        let rounds = (0..self.seeds).flat_map(|seed| self.suites.iter().flat_map(move |suite| suite.round(seed)));
        let mut cases = Vec::new();
        for case in rounds {
            let wanted = self.only.as_ref().is_none_or(|only| case.names.contains(only));
            if wanted && !cases.contains(&case) {
                cases.push(case);
            }
        }
        cases
    }

    /// A handful of sets that show that everything runs: a defect of geometry, one of reflectance, none, and an unknown one.
    pub fn short() -> Vec<Case> {
        let cases = [
            (Suite::Single, &["elevation_offset"][..]),
            (Suite::Single, &["ring_gain"]),
            (Suite::Nothing, &[]),
            (Suite::Unknown, &["range_by_sweep_phase"]),
        ];
        let case = |(suite, names): (Suite, &[&str])| Case {
            suite,
            names: names.iter().map(|name| (*name).to_owned()).collect(),
            size: 1.0,
            number: 0,
        };
        cases.into_iter().map(case).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_question_is_asked_as_often_as_there_are_seeds() {
        let selection = Selection { suites: Suite::ALL.to_vec(), seeds: 5, only: None };
        let cases = selection.cases();
        for name in LIBRARY {
            assert_eq!(cases.iter().filter(|c| c.suite == Suite::Single && c.names == [*name]).count(), 5, "{name}");
        }
        assert_eq!(cases.iter().filter(|c| c.suite == Suite::Nothing).count(), 100);
        let seeds: BTreeSet<u64> = cases.iter().filter(|c| c.suite != Suite::Size).map(Case::seed).collect();
        assert_eq!(seeds.len(), cases.iter().filter(|c| c.suite != Suite::Size).count(), "sets are independent");
    }

    #[test]
    fn a_size_changes_nothing_but_the_size() {
        let selection = Selection { suites: vec![Suite::Size], seeds: 1, only: Some("elevation_offset".into()) };
        let cases = selection.cases();
        assert_eq!(cases.len(), SIZES_LOG2.count());
        assert!(cases.iter().all(|case| case.seed() == cases[0].seed()));
    }

    #[test]
    fn the_confused_and_the_nested_are_names_of_the_library() {
        let mut names = CONFUSED.iter().chain(NESTED).flatten().chain(SIZED);
        assert!(names.all(|name| LIBRARY.contains(name)));
    }
}
