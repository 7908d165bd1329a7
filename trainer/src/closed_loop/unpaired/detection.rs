//! The power below which returns are lost: what `weak_return_drop` needs.

use crate::closed_loop::significance::normal_tail;

use super::cells::Powers;

/// Bins with fewer rays say nothing of their own.
const LEAST_RAYS: f64 = 30.0;

/// Steps to either side of the best so far, as parts of what is searched.
const STEPS: [f64; 7] = [-1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0];

/// Softer, a threshold is none: the most that the effect takes.
const SOFTEST: f64 = 5.0;

/// A standard normal number exceeds this with a probability of a tenth.
pub(super) const TENTH: f64 = 1.281_6;

/// How often the search narrows: to a thousandth.
const REFINEMENTS: usize = 14;

/// keep = c·Φ((ln P − ln P₀)/s) times what the simulated half keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Detection {
    pub(super) log_p0: f64,
    pub(super) softness: f64,
    /// c.
    pub(super) rest: f64,
    /// Share of the returns that is lost for being weak where the least power is expected.
    pub(super) lost: f64,
}

impl Detection {
    /// Keep at a power, the base drop aside.
    pub(super) fn keep(&self, log_power: f64) -> f64 {
        1.0 - normal_tail((log_power - self.log_p0) / self.softness)
    }

    /// Whether it is a threshold at all: a loss that spreads over all powers is none.
    pub(super) fn is_threshold(&self) -> bool {
        self.softness < 0.98 * SOFTEST
    }

    /// ln of the power that a tenth of the returns are too weak for.
    pub(super) fn log_tenth(&self) -> f64 {
        self.log_p0 + TENTH * self.softness
    }

    /// Maximum likelihood, on a grid that is refined twice.
    pub(super) fn fit(simulated: &Powers, measured: &Powers) -> Option<Self> {
        let usual =
            simulated.iter().map(|c| c.missing).sum::<f64>() / simulated.iter().map(|c| c.rays).sum::<f64>().max(1.0);
        let bins: Vec<(f64, f64, f64, f64)> = (simulated.iter().zip(measured))
            .filter(|(_, m)| m.rays >= LEAST_RAYS)
            .map(|(s, m)| {
                let kept = 1.0 - (s.missing + LEAST_RAYS * usual) / (s.rays + LEAST_RAYS);
                (m.log_power / m.rays, kept, m.rays - m.missing, m.missing)
            })
            .collect();
        if bins.len() < 3 {
            return None;
        }
        let likelihood = |d: &Self| -> f64 {
            let of = |(power, usual, kept, missing): &(f64, f64, f64, f64)| {
                let keep = (d.rest * usual * d.keep(*power)).clamp(1e-6, 1.0 - 1e-6);
                kept * keep.ln() + missing * (1.0 - keep).ln()
            };
            bins.iter().map(of).sum()
        };
        let mut best = Self { log_p0: -14.0, softness: 0.5, rest: 1.0, lost: 0.0 };
        let mut value = likelihood(&best);
        let (mut span, mut middle) = ([8.0, 2.0, 0.1], best);
        for _ in 0..REFINEMENTS {
            for [i, j, k] in grid() {
                let tried = Self {
                    log_p0: middle.log_p0 + span[0] * i,
                    softness: (middle.softness.ln() + span[1] * j).exp().clamp(0.05, SOFTEST),
                    rest: middle.rest + span[2] * k,
                    lost: 0.0,
                };
                let found = likelihood(&tried);
                if found > value {
                    (best, value) = (tried, found);
                }
            }
            middle = best;
            span = span.map(|s| 0.6 * s);
        }
        let lost = bins.iter().map(|(power, ..)| 1.0 - best.keep(*power)).fold(0.0, f64::max);
        Some(Self { lost, ..best })
    }
}

fn grid() -> impl Iterator<Item = [f64; 3]> {
    STEPS.into_iter().flat_map(|i| STEPS.into_iter().flat_map(move |j| STEPS.into_iter().map(move |k| [i, j, k])))
}

/// Chances of several scenes together.
pub(super) fn together<'a>(scenes: impl Iterator<Item = &'a Powers>) -> Powers {
    scenes.fold(Powers::default(), |sum, scene| std::array::from_fn(|bin| sum[bin] + scene[bin]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_loop::unpaired::cells::{Chances, log_power};

    #[test]
    fn the_weakest_power_is_found_beside_a_base_drop() {
        let truth = Detection { log_p0: -11.0, softness: 0.5, rest: 1.0, lost: 0.0 };
        let powers = |keep: &dyn Fn(f64) -> f64| -> Powers {
            std::array::from_fn(|bin| {
                let power = log_power(bin);
                Chances { rays: 1000.0, missing: 1000.0 * (1.0 - 0.95 * keep(power)), log_power: 1000.0 * power }
            })
        };
        let found = Detection::fit(&powers(&|_| 1.0), &powers(&|p| truth.keep(p))).expect("a fit");
        assert!(
            (found.log_p0 - truth.log_p0).abs() < 0.1 && (found.softness - truth.softness).abs() < 0.1,
            "{found:?}"
        );
        let none = Detection::fit(&powers(&|_| 1.0), &powers(&|_| 1.0)).expect("a fit");
        assert!(none.lost < 0.002, "{none:?}");
    }
}
