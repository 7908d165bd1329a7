//! What came of a trace: the effect with its numbers, or what has no name, and the curve.

use super::super::cells::{INCIDENCE_DEG, log_power, range_m};
use super::super::compare::{Resampled, deviation};
use super::super::covariate::Over;
use super::super::finding::{Curve, Point, Tried};
use super::Traces;
use crate::closed_loop::model::Term;
use crate::closed_loop::outcome::{Found, Interval, Unexplained};
use crate::effects::{Channel, library};

/// Least share of the weakest returns whose loss is reported though it has no threshold.
const LEAST_LOST: f64 = 0.01;

/// A near range overlap that changes nothing: `reflectance_falloff` without it.
const NO_OVERLAP: [f64; 2] = [0.02, 2.0];

impl Traces {
    /// What came of it.
    pub(in super::super) fn tried(&self, q: f64, ties: &[String]) -> Tried {
        let share = self.laws.share(&self.coefficients.simulated.value, &self.coefficients.measured.value);
        Tried {
            over: self.over,
            gain: self.gain.nats,
            placebo: self.gain.placebo,
            p: self.gain.p,
            q,
            size: self.size(),
            share,
            residual: self.residual,
            unexplained: self.unexplained(q, share),
            found: if self.passes(q) { self.found(q, ties) } else { None },
            curve: self.curve(),
        }
    }

    fn found(&self, q_value: f64, ties: &[String]) -> Option<Found> {
        let effect = library().into_iter().find(|effect| effect.about().name == self.over.effect())?;
        let (value, stderr) = self.coefficients.difference();
        let term = Term::new(effect, self.rings);
        let (mut physical, mut stderr) = match self.over {
            Over::Ring => {
                let log_gains = self.centred(&value);
                let gains = log_gains.iter().map(|g| g.exp()).collect::<Vec<_>>();
                let stderr = gains
                    .iter()
                    .zip(&stderr)
                    .zip(&self.known)
                    .map(|((g, e), known)| if *known { g * e } else { f64::NAN });
                (gains.clone(), stderr.collect())
            }
            Over::Range => {
                let (found, draws) = self.falloff.as_ref()?;
                let overlap = found.overlap.unwrap_or(NO_OVERLAP);
                let mut errors = vec![deviation(draws.iter().map(|d| d.beta_per_m)), f64::NAN, f64::NAN];
                if found.overlap.is_some() {
                    for i in 0..2 {
                        errors[i + 1] = deviation(draws.iter().filter_map(|d| d.overlap).map(|overlap| overlap[i]));
                    }
                }
                (vec![found.beta_per_m, overlap[0], overlap[1]], errors)
            }
            Over::Incidence => (vec![value[0]], vec![stderr[0]]),
            Over::Power => {
                let (found, draws) = self.detection.as_ref()?;
                let errors =
                    [deviation(draws.iter().map(|d| d.log_p0.exp())), deviation(draws.iter().map(|d| d.softness))];
                (vec![found.log_p0.exp(), found.softness], errors.to_vec())
            }
        };
        // What strata do not tell stays where a fit would start.
        physical.extend_from_slice(&term.physical()[physical.len()..]);
        stderr.resize(physical.len(), f64::NAN);
        Some(Found { term: term.at(&physical), stderr, gain: self.gain.nats, q_value, ties: ties.to_vec() })
    }

    fn curve(&self) -> Curve {
        let of = |half: &Resampled, i: usize| {
            let interval = half.interval(i, &|value| self.mean(value));
            let shown = |x: f64| if self.over == Over::Power { x } else { x.exp() };
            Interval { value: shown(interval.value), ci95: interval.ci95.map(shown) }
        };
        let at = |i: usize| match self.over {
            Over::Ring => i as f64,
            Over::Range => range_m(i),
            Over::Incidence => (i as f64 + 0.5) * INCIDENCE_DEG,
            Over::Power => log_power(i),
        };
        let points = (0..self.known.len()).filter(|i| self.known[*i]).map(|i| Point {
            at: at(i),
            simulated: of(&self.table.simulated, i),
            measured: of(&self.table.measured, i),
        });
        Curve { points: points.collect() }
    }

    /// Returns that are lost the more the less power is expected of them, though by no threshold.
    fn unexplained(&self, q_value: f64, share_of_residual: f64) -> Option<Unexplained> {
        let known: Vec<usize> = (0..self.known.len()).filter(|i| self.known[*i]).collect();
        let (more, _) = self.table.difference();
        let weakest = known.first().map_or(0.0, |i| more[*i] - self.mean(&more));
        let is = self.over == Over::Power && self.is_sure(q_value) && !self.passes(q_value) && weakest > LEAST_LOST;
        is.then(|| Unexplained {
            channel: Channel::Missing,
            covariates: ["range", "incidence", "reflectance"].map(Into::into).to_vec(),
            share_of_residual,
            q_value,
            added_as_table: false,
        })
    }
}
