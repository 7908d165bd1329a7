//! A paired set in, what the loop found out.

use burn::tensor::Device;

use super::data::{Batch, Pair, batches};
use super::improve::{Progress, improve};
use super::model::SensorModel;
use super::outcome::Outcome;
use super::split::Split;
use crate::sets::PairedSet;

/// A calibration: what it was done on, and what it found.
#[derive(Debug)]
pub struct Calibration {
    /// Which frames were for what.
    pub split: Split,
    /// The frames that were opened once, at the end.
    pub confirm: Vec<Batch>,
    /// What the loop found on the others.
    pub outcome: Outcome,
}

/// The pairs of a set whose generator is the ideal pass-through.
pub fn pairs(set: &PairedSet) -> Vec<Pair> {
    let pair = |(frame, f): (usize, &crate::sets::Frame)| Pair {
        frame,
        scene: f.scene,
        simulated: f.simulated.clone(),
        keep: None,
        measured: f.measured.clone(),
    };
    set.frames.iter().enumerate().map(pair).collect()
}

/// Closes the loop on a set.
pub fn calibrate(
    set: &PairedSet,
    pairs: &[Pair],
    before: &SensorModel,
    seed: u64,
    progress: Progress<'_>,
) -> Calibration {
    let split = Split::new(pairs, seed);
    let device = Device::flex().autodiff();
    let part = |frames: &[usize]| batches(&frames.iter().map(|i| &pairs[*i]).collect::<Vec<_>>(), &set.sensor, &device);
    let (discover, tune) = (part(&split.discover), part(&split.tune));
    let mut outcome = improve(before, [discover.iter().collect(), tune.iter().collect()], progress);
    outcome.caveats.extend(set.notes.iter().cloned());
    outcome.caveats.extend(split.caveats.iter().cloned());
    let confirm = part(&split.confirm);
    Calibration { split, confirm, outcome }
}
