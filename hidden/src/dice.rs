//! Random numbers: one `ChaCha` stream for each thing that is random, so that a change in one leaves the others as they were.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// The generator of everything random here; `ChaCha` gives the same numbers on every machine.
pub(crate) type Dice = ChaCha8Rng;

/// What a stream of random numbers is for.
#[derive(Clone, Copy)]
pub(crate) enum Purpose {
    /// The street of a scene and the poses in it.
    Scene,
    /// Noise and drop of a frame.
    Noise,
    /// What the n-th defect of the recipe does to a frame.
    Defect(usize),
}

/// The stream of `purpose` for scene or frame `index`.
pub(crate) fn dice(seed: u64, purpose: Purpose, index: usize) -> Dice {
    let lane = match purpose {
        Purpose::Scene => 0,
        Purpose::Noise => 1,
        Purpose::Defect(n) => 2 + n as u64,
    };
    let mut dice = Dice::seed_from_u64(seed);
    dice.set_stream(lane << 32 | index as u64);
    dice
}

/// A standard normal number.
pub(crate) fn normal(dice: &mut dyn Rng) -> f64 {
    dice.sample(StandardNormal)
}

/// +1 or −1.
pub(crate) fn sign(dice: &mut dyn Rng) -> f64 {
    if dice.random() { 1.0 } else { -1.0 }
}

/// One normal number a ring, of this standard deviation and with a mean of exactly 0: what all rings share is another defect.
pub(crate) fn ring_pattern(rings: usize, sigma: f64, dice: &mut dyn Rng) -> Vec<f64> {
    let drawn: Vec<f64> = (0..rings).map(|_| sigma * normal(dice)).collect();
    let mean = drawn.iter().sum::<f64>() / rings as f64;
    drawn.into_iter().map(|value| value - mean).collect()
}
