//! Azimuth or sweep phase? A sensor that turns steadily makes either a function of the other, so a table cannot tell.
//!
//! What can is the seam: something that lies around the sensor goes on where the turn closes, something that runs with time jumps there.
//! So time is claimed only where a ramp with its jump explains, in scenes held out, what waves around the turn leave over.

use super::cells::{Scored, cross_validated, smooth};
use super::{CHANNELS, Dependence, Entry, Sheet};
use crate::closed_loop::significance::{Block, p_value};
use crate::effects::Covariate;

/// Waves around the turn. They explain 83 % of a ramp.
const HARMONICS: usize = 3;

/// Share of what waves and ramp explain together that the ramp has to add.
const LEAST_SHARE: f64 = 0.05;

/// Probability of such an addition by chance that is small enough.
const LARGEST_P: f64 = 0.01;

/// Keeps, in each channel, one of the two alone and in pairs: azimuth, unless the residual jumps at the seam.
pub(super) fn choose(sheet: &Sheet, fold: &[bool], dependences: &mut Vec<Dependence>) {
    let Some(turn) = sheet.columns.iter().position(|c| c.covariate == Covariate::SweepPhase) else { return };
    let last = (sheet.columns[turn].fine.count - 1) as f64;
    for (c, channel) in CHANNELS.into_iter().enumerate() {
        let tables = sheet.tables(Entry::Single(turn), &sheet.residuals.standardised[c]);
        let score = |basis: &dyn Fn(f64) -> Vec<f64>| {
            let at = |cell: usize| basis((cell as f64 + 0.5) / last);
            cross_validated(&tables, fold, &|train| smooth(train, &at))
        };
        let loser =
            if jumps(&score(&waves), &score(&waves_and_ramp)) { Covariate::Azimuth } else { Covariate::SweepPhase };
        dependences.retain(|d| d.channel != channel || !d.covariates.contains(&loser));
    }
}

fn jumps(without: &Scored, with: &Scored) -> bool {
    let added: Vec<Block> =
        with.gain.iter().zip(&without.gain).map(|(with, without)| Block { scene: 0, sum: with - without }).collect();
    let sum: f64 = added.iter().map(|b| b.sum).sum();
    sum > LEAST_SHARE * with.total().max(0.0) && p_value(&added) < LARGEST_P
}

/// 1 and the first harmonics, at a share of the turn.
fn waves(turn: f64) -> Vec<f64> {
    let angle = |k: usize| 2.0 * std::f64::consts::PI * k as f64 * turn;
    std::iter::once(1.0).chain((1..=HARMONICS).flat_map(|k| [angle(k).cos(), angle(k).sin()])).collect()
}

fn waves_and_ramp(turn: f64) -> Vec<f64> {
    let mut basis = waves(turn);
    basis.push(turn - 0.5);
    basis
}
