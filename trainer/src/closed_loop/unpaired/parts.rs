//! Which scenes are for finding, which for confirming.

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use crate::closed_loop::outcome::Caveat;

/// A half with fewer scenes keeps none back.
const LEAST_TO_CONFIRM: usize = 6;

/// A half with fewer scenes says nothing.
const LEAST_SCENES: usize = 3;

/// Scenes by their part, simulated and measured.
#[derive(Clone, Debug)]
pub(super) struct Parts {
    pub(super) scenes: [usize; 2],
    /// Scenes that effects are found on.
    pub(super) discover: [Vec<usize>; 2],
    /// Scenes that are opened once, at the end: none if there are few.
    pub(super) confirm: [Vec<usize>; 2],
    pub(super) caveats: Vec<Caveat>,
}

impl Parts {
    pub(super) fn new(scenes: [usize; 2], seed: u64) -> Self {
        let mut dice = ChaCha8Rng::seed_from_u64(seed);
        let enough = scenes.iter().all(|n| *n >= LEAST_TO_CONFIRM);
        let [simulated, measured] = scenes.map(|n| {
            let mut order: Vec<usize> = (0..n).collect();
            order.shuffle(&mut dice);
            let confirm = if enough { n * 3 / 10 } else { 0 };
            let mut discover = order.split_off(confirm);
            discover.sort_unstable();
            order.sort_unstable();
            (discover, order)
        });
        let mut caveats = Vec::new();
        if scenes.iter().any(|n| *n < LEAST_SCENES) {
            let [simulated, measured] = scenes;
            caveats.push(format!(
                "{simulated} simulated and {measured} measured scenes: with fewer than {LEAST_SCENES} of either nothing is claimed"
            ));
        } else if !enough {
            caveats.push(format!(
                "fewer than {LEAST_TO_CONFIRM} scenes in a half: none was kept back to confirm what was found"
            ));
        }
        Self { scenes, discover: [simulated.0, measured.0], confirm: [simulated.1, measured.1], caveats }
    }

    /// Whether there are scenes enough to claim anything.
    pub(super) fn suffice(&self) -> bool {
        self.scenes.iter().all(|n| *n >= LEAST_SCENES)
    }
}
