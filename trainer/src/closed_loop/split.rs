//! Which scenes are for finding, which for choosing, which for confirming.

use std::collections::BTreeSet;

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::data::Pair;

/// Frames by their part, as indices into the pairs, each in order.
///
/// Discovery and tuning exchange their parts: what is fitted on one is scored on the other, so every frame of both is held out once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Split {
    /// Frames that effects are found on.
    pub discover: Vec<usize>,
    /// Frames that they are chosen on.
    pub tune: Vec<usize>,
    /// Frames that are opened once, at the end.
    pub confirm: Vec<usize>,
    /// What the split cannot give.
    pub caveats: Vec<String>,
}

impl Split {
    /// Splits whole scenes; fewer than three scenes are split by frames, and fewer than three frames not at all.
    pub fn new(pairs: &[Pair], seed: u64) -> Self {
        let scenes: BTreeSet<usize> = pairs.iter().map(|p| p.scene).collect();
        let mut caveats = Vec::new();
        let unit_of: Vec<usize> = if scenes.len() >= 3 {
            pairs.iter().map(|p| p.scene).collect()
        } else {
            caveats.push(format!(
                "{} of at least three scenes: discovery and confirmation share scenes, so nothing is said about scenes never seen",
                scenes.len()
            ));
            (0..pairs.len()).collect()
        };
        let mut units: Vec<usize> = unit_of.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
        if units.len() < 3 {
            caveats
                .push(format!("{} of at least three frames: errors are of the frames that were fitted", pairs.len()));
            let all: Vec<usize> = (0..pairs.len()).collect();
            return Self { discover: all.clone(), tune: all.clone(), confirm: all, caveats };
        }
        units.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
        let confirm = (units.len() * 3 / 10).max(1);
        let discover = (units.len() - confirm).div_ceil(2);
        let part = |range: std::ops::Range<usize>| {
            let of: BTreeSet<usize> = units[range].iter().copied().collect();
            (0..pairs.len()).filter(|i| of.contains(&unit_of[*i])).collect::<Vec<_>>()
        };
        Self {
            discover: part(0..discover),
            tune: part(discover..units.len() - confirm),
            confirm: part(units.len() - confirm..units.len()),
            caveats,
        }
    }
}
