//! How a translation's losses are minimised.

use serde::{Deserialize, Serialize};

use crate::train::Plan;

/// How the losses are minimised.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Schedule {
    /// Optimiser steps.
    pub steps: usize,
    /// Scans of each domain a step.
    pub batch: usize,
    /// Columns of a cut-out; a whole turn where it is the sensor's number of columns.
    pub crop_columns: usize,
    /// Adam's learning rate to begin with.
    pub learning_rate: f64,
    /// Steps after which the learning rate is multiplied by [`decay`](Self::decay), again and again; 0 = never.
    pub decay_every: usize,
    /// See [`decay_every`](Self::decay_every).
    pub decay: f64,
    /// Adam's decay of the mean gradient; CUT's β₁. That of its square is 0.999.
    pub beta_1: f32,
    /// Longest gradient of a parameter tensor; longer ones are shortened to it.
    pub clip_norm: f32,
    /// Per step, the share of the averaged generator that stays: the exponential moving average that is validated and exported. 0 = the
    /// generator itself.
    pub average: f64,
    /// Steps between two checkpoints; each is scored on the validation scans.
    pub checkpoint_every: usize,
    /// Steps between two pictures; 0 = none.
    pub samples_every: usize,
    /// Checkpoints without a better score after which training ends early; 0 = never.
    pub patience: usize,
}

impl Default for Schedule {
    /// The paper's rate, decay and batch.
    fn default() -> Self {
        Self {
            steps: 4000,
            batch: 12,
            crop_columns: 256,
            learning_rate: 5e-5,
            decay_every: 0,
            decay: 0.5,
            beta_1: 0.5,
            clip_norm: 10.0,
            average: 0.999,
            checkpoint_every: 250,
            samples_every: 250,
            patience: 0,
        }
    }
}

impl Schedule {
    /// What the training loop has to know of it.
    pub fn plan(&self) -> Plan {
        let Self { steps, checkpoint_every, samples_every, patience, .. } = *self;
        Plan { steps, checkpoint_every, samples_every, patience }
    }

    /// The learning rate of a step.
    pub fn rate(&self, step: usize) -> f64 {
        let decays = step.checked_div(self.decay_every).unwrap_or(0);
        self.learning_rate * self.decay.powi(decays.min(1000) as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_learning_rate_falls_in_steps() {
        let schedule = Schedule { learning_rate: 1e-3, decay_every: 10, decay: 0.5, ..Schedule::default() };
        assert_eq!([0, 9, 10, 25].map(|step| schedule.rate(step)), [1e-3, 1e-3, 5e-4, 2.5e-4]);
        assert_eq!(Schedule { decay_every: 0, ..schedule }.rate(1000), 1e-3);
    }
}
