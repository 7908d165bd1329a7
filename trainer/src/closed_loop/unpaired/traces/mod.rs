//! The trace of one effect in both halves: how sure it is, and how large.

mod claim;

use nalgebra::DVector;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Half;
use super::cells::{Cells, Makes, Powers, range_m};
use super::compare::{Coefficients, Gain, Halves, deviation};
use super::covariate::{NEAR, Over, View};
use super::detection::{Detection, together};
use super::evidence::Evidence;
use super::falloff::{Falloff, Ratio};
use super::parts::Parts;
use crate::closed_loop::significance::{Block, p_value};

/// Largest share of false claims.
pub(super) const FALSE_CLAIMS: f64 = 0.05;

/// A ring or bin of which a half knows less, in cells a scan, is not shown.
const LEAST_KNOWN: f64 = 2.0;

/// Resamplings of the scenes for the power below which returns are lost.
const RESAMPLINGS: u64 = 40;

/// The trace of an effect.
#[derive(Clone, Debug)]
pub(super) struct Traces {
    over: Over,
    rings: usize,
    /// The effect's own numbers, and a table over its covariate.
    laws: Halves,
    table: Coefficients,
    known: Vec<bool>,
    gain: Gain,
    coefficients: Coefficients,
    /// Scatter on the confirm scenes, before and after.
    residual: Option<[f64; 2]>,
    suffice: bool,
    /// For [`Over::Range`]: the fading, with what it is on other scenes.
    falloff: Option<(Falloff, Vec<Falloff>)>,
    /// For [`Over::Power`]: the power below which returns are lost, with what it is on other scenes.
    detection: Option<(Detection, Vec<Detection>)>,
}

impl Traces {
    /// Compares simulated and measured scenes.
    pub(super) fn new(over: Over, halves: [&Half; 2], views: [&View; 2], parts: &Parts, seed: u64) -> Self {
        let of = |of: &(dyn Fn(&Cells, usize, &View) -> Evidence + Sync)| Halves {
            simulated: halves[0].evidence(|cells, frames| of(cells, frames, views[0])),
            measured: halves[1].evidence(|cells, frames| of(cells, frames, views[1])),
        };
        let laws = of(&|cells, frames, view| over.law(cells, frames, view));
        let tables = of(&|cells, frames, view| over.table(cells, frames, view));
        let of_parts = |parts: &[Vec<usize>; 2]| laws.of(&parts[0], &parts[1]);
        let discovery = of_parts(&parts.discover);
        let confirm = (!parts.confirm[1].is_empty()).then(|| of_parts(&parts.confirm));
        let of_discovery = |half: &[Evidence]| Evidence::estimate(half.iter(), laws.columns());
        let residual = confirm.map(|confirm| {
            [&discovery.simulated, &discovery.measured].map(|half| confirm.residual(&of_discovery(half)))
        });
        let says = |half: &[Evidence], i: usize| {
            half.iter().map(|e| e.precision(i)).sum::<f64>() / half.len() as f64 > LEAST_KNOWN
        };
        let known = (0..tables.columns()).map(|i| says(&tables.simulated, i) && says(&tables.measured, i)).collect();
        let mut traces = Self {
            over,
            rings: views[0].elevations_rad.len(),
            known,
            gain: discovery.gain(seed),
            table: tables.coefficients(seed),
            coefficients: laws.coefficients(seed),
            laws,
            residual,
            suffice: parts.suffice(),
            falloff: None,
            detection: (over == Over::Power).then(|| detection(&halves.map(Half::powers), seed)).flatten(),
        };
        traces.falloff = (over == Over::Range).then(|| traces.fading()).flatten();
        traces
    }

    /// Bins of range that are known, and their middles in m.
    fn ranges(&self) -> impl Iterator<Item = (usize, f64)> {
        (0..self.known.len()).filter(|i| self.known[*i]).map(|i| (i, range_m(i)))
    }

    /// How reflectance fades over the bins of range.
    fn fading(&self) -> Option<(Falloff, Vec<Falloff>)> {
        let (slope, stderr) = self.coefficients.difference();
        let with_overlap = slope[NEAR] > 2.0 * stderr[NEAR];
        let (value, stderr) = self.table.difference();
        let ratios = |value: &DVector<f64>| -> Vec<Ratio> {
            self.ranges()
                .map(|(i, range_m)| Ratio { range_m, log: value[i], variance: stderr[i].powi(2).max(1e-6) })
                .collect()
        };
        let found = Falloff::fit(&ratios(&value), with_overlap)?;
        let draws = self.table.draws();
        Some((found, draws.iter().filter_map(|draw| Falloff::fit(&ratios(draw), with_overlap)).collect()))
    }

    /// Probability of such a gain where the halves are alike.
    pub(super) fn p(&self) -> f64 {
        self.gain.p
    }

    /// ln of the power that a tenth of the returns are too weak for.
    pub(super) fn log_tenth(&self) -> Option<f64> {
        self.detection.as_ref().map(|(found, _)| found.log_tenth())
    }

    /// Gain, nats a cell.
    pub(super) fn nats(&self) -> f64 {
        self.gain.nats.value
    }

    /// Whether another effect explains the same scenes no worse, but for chance.
    pub(super) fn ties_with(&self, other: &Self) -> bool {
        let more = self.gain.by_scene.iter().zip(&other.gain.by_scene).enumerate();
        let blocks: Vec<Block> = more.map(|(scene, (a, b))| Block { scene, sum: a - b }).collect();
        p_value(&blocks) > FALSE_CLAIMS
    }

    /// Where it would show.
    pub(super) fn over(&self) -> Over {
        self.over
    }

    /// Name of the effect.
    pub(super) fn name(&self) -> &'static str {
        self.over.effect()
    }

    /// Whether it may be claimed.
    pub(super) fn passes(&self, q: f64) -> bool {
        let [size, least] = self.size();
        self.is_sure(q) && size >= least
    }

    /// Whether the halves differ beyond chance and placebo, on the confirm scenes too.
    fn is_sure(&self, q: f64) -> bool {
        let confirmed = self.residual.is_none_or(|[before, after]| after < before);
        self.suffice && q <= FALSE_CLAIMS && self.gain.nats.value > self.gain.placebo && confirmed
    }

    /// Size of the effect, and the least that is claimed: scatter of the rings' ln gains beyond its error, scatter of the ln factor over the
    /// bins of range, exponent, share of the weakest returns that is lost.
    fn size(&self) -> [f64; 2] {
        let (value, stderr) = self.coefficients.difference();
        match self.over {
            Over::Ring => {
                let (value, known) = (self.centred(&value), self.known.iter().filter(|k| **k).count());
                let squares = value.iter().zip(&stderr).zip(&self.known).filter(|(_, known)| **known);
                let sum: f64 = squares.map(|((v, e), _)| v * v - e * e).sum();
                [(sum / known.max(1) as f64).max(0.0).sqrt(), 0.02]
            }
            Over::Range => {
                let factors = self.falloff.iter().flat_map(|(falloff, _)| self.ranges().map(|(_, r)| falloff.log(r)));
                [deviation(factors), 0.05]
            }
            Over::Incidence => [value[0].abs(), 0.05],
            Over::Power => {
                let threshold = self.detection.as_ref().filter(|(found, _)| found.is_threshold());
                [threshold.map_or(0.0, |(found, _)| found.lost), 0.02]
            }
        }
    }

    /// Numbers of the rings or bins about their mean; 0 where nothing is known.
    fn centred(&self, value: &DVector<f64>) -> Vec<f64> {
        let mean = self.mean(value);
        value.iter().zip(&self.known).map(|(v, known)| if *known { v - mean } else { 0.0 }).collect()
    }

    fn mean(&self, value: &DVector<f64>) -> f64 {
        let known = || value.iter().zip(&self.known).filter(|(_, known)| **known).map(|(v, _)| *v);
        match self.over {
            // Returns are strong in the upper half of the bins that are known.
            Over::Power => {
                let all: Vec<f64> = known().collect();
                let strong = &all[all.len() / 2..];
                strong.iter().sum::<f64>() / strong.len().max(1) as f64
            }
            _ => known().sum::<f64>() / known().count().max(1) as f64,
        }
    }

    /// Enters what the sensor makes of reflectance.
    pub(super) fn enter(&self, makes: &mut Makes) {
        let (value, _) = self.coefficients.difference();
        match self.over {
            Over::Ring => makes.log_gains = self.centred(&value),
            Over::Range => makes.falloff = self.falloff.as_ref().map(|(found, _)| *found).unwrap_or_default(),
            Over::Incidence => makes.exponent = value[0],
            Over::Power => {}
        }
    }
}

/// The power below which returns are lost, and what it is on other scenes of the same kind.
fn detection(powers: &[Vec<Powers>; 2], seed: u64) -> Option<(Detection, Vec<Detection>)> {
    let [simulated, measured] = powers;
    let found = Detection::fit(&together(simulated.iter()), &together(measured.iter()))?;
    let draws = (0..RESAMPLINGS).filter_map(|k| {
        let mut dice = ChaCha8Rng::seed_from_u64(seed ^ (k << 20));
        let mut drawn = |half: &[Powers]| {
            let scenes: Vec<usize> = (0..half.len()).map(|_| dice.random_range(0..half.len())).collect();
            together(scenes.iter().map(|i| &half[*i]))
        };
        let (simulated, measured) = (drawn(simulated), drawn(measured));
        Detection::fit(&simulated, &measured)
    });
    Some((found, draws.collect()))
}
