//! The likelihood of a model as a function of its free numbers.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use burn::tensor::{Device, Tensor, s};
use rayon::prelude::*;

use super::data::Batch;
use super::fit::{Free, On};
use super::likelihood;
use super::model::{SensorModel, Term};
use super::newton::{Groups, Objective};
use super::score::{Scope, counted, per_block};
use crate::effects::{ActsOn, Extent, Image, Kind, Settled};

/// Values that are tried for a number, in units of the typical size: from minus four to four.
const SCANNED: std::ops::RangeInclusive<i32> = -20..=20;

/// The step between them.
const SCAN_STEP: f64 = 0.2;

/// Rays that are enough to find a single number's peak.
const SCANNED_RAYS: usize = 65_536;

/// What is fitted to what; everything that does not change is worked out once.
pub(super) struct Problem<'a> {
    held_last: Vec<&'a Term>,
    free: &'a [Free],
    acts_on: ActsOn,
    batches: Vec<Prepared<'a>>,
    device: Device,
}

struct Prepared<'a> {
    batch: &'a Batch,
    image: Image,
    /// Rays that count; `None` where all do.
    settled: Option<Settled>,
    /// The image with its rays moved, and the numbers that moved them.
    moved: Mutex<Option<(Vec<f64>, Image)>>,
}

/// Its negative log-likelihood, under normals that may be widened.
pub(super) struct Softened<'a> {
    pub(super) problem: &'a Problem<'a>,
    /// By how much normals are widened.
    pub(super) soften: f64,
}

impl<'a> Problem<'a> {
    pub(super) fn new(model: &'a SensorModel, free: &'a [Free], on: &On<'a>) -> Self {
        let is_free = |term: &&Term| free.iter().any(|f| f.term.name() == term.name());
        let held: Vec<&Term> = model.terms.iter().filter(|t| !is_free(t)).collect();
        let (moving, other): (Vec<&Term>, Vec<&Term>) = held.into_iter().partition(|t| t.is_geometric());
        let moves = free.iter().any(|f| f.term.is_geometric());
        let prepare = |batch: &'a Batch| {
            let image = moving.iter().fold(batch.image.clone(), |image, term| term.forward(image));
            if moves {
                return Prepared { batch, image, settled: None, moved: Mutex::default() };
            }
            let image = image.resample();
            let settled = if on.scope == Scope::Settled { image.settled() } else { None };
            let image = other.iter().fold(image, |image, term| term.forward(image));
            Prepared { batch, image, settled, moved: Mutex::default() }
        };
        Self {
            batches: on.batches.par_iter().copied().map(prepare).collect(),
            held_last: if moves { other } else { vec![] },
            free,
            acts_on: on.channels,
            device: on.batches.first().map_or_else(Device::flex, |b| b.image.device()),
        }
    }

    /// The free numbers where the fit starts.
    pub(super) fn start(&self) -> Vec<f64> {
        self.free.iter().flat_map(|f| f.ranges().into_iter().flat_map(|r| f.term.fitted[r].to_vec())).collect()
    }

    pub(super) fn groups(&self) -> Groups {
        Groups::new(self.free.iter().flat_map(Free::groups))
    }

    /// Which of the numbers are means rather than spreads or probabilities.
    pub(super) fn means(&self) -> Vec<usize> {
        let kinds = self.free.iter().flat_map(Free::kinds).enumerate();
        kinds.filter(|(_, kind)| *kind == Kind::Free).map(|(i, _)| i).collect()
    }

    pub(super) fn groups_of_means(&self) -> Groups {
        let is_mean = |free: &Free| {
            let (parameters, groups) = (free.parameters.clone(), free.groups());
            let kind = |i: usize| free.term.parameters[i].kind;
            parameters
                .into_iter()
                .zip(groups)
                .filter(|(i, _)| kind(*i) == Kind::Free)
                .map(|(_, g)| g)
                .collect::<Vec<_>>()
        };
        Groups::new(self.free.iter().flat_map(is_mean))
    }

    /// The gradient of each scene's likelihood.
    pub(super) fn gradients_by_scene(&self, x: &[f64]) -> Vec<Vec<f64>> {
        let parts: Vec<(usize, Vec<f64>)> =
            self.batches.par_iter().map(|b| (b.batch.scene, self.of_batch(b, x, 0.0).1)).collect();
        let mut scenes: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for (scene, gradient) in parts {
            let sum = scenes.entry(scene).or_insert_with(|| vec![0.0; x.len()]);
            sum.iter_mut().zip(gradient).for_each(|(sum, g)| *sum += g);
        }
        scenes.into_values().collect()
    }

    pub(super) fn terms(&self, x: &[f64]) -> Vec<Term> {
        let mut next = x.iter();
        let fill = |free: &Free| {
            let mut term = free.term.clone();
            for i in free.ranges().into_iter().flatten() {
                term.fitted[i] = *next.next().unwrap_or_else(|| unreachable!("as many numbers as are free"));
            }
            term
        };
        self.free.iter().map(fill).collect()
    }

    /// The image with its rays moved by the free terms at these numbers, `fitted` being a tensor a term.
    fn moved(&self, prepared: &Prepared<'_>, fitted: &[Tensor<1>]) -> Image {
        self.with(true, prepared.image.clone(), fitted).resample()
    }

    /// What the sensor reports of an image whose rays have been moved.
    fn reported(&self, moved: Image, fitted: &[Tensor<1>]) -> Image {
        self.with(false, self.held_last.iter().fold(moved, |image, term| term.forward(image)), fitted)
    }

    fn with(&self, geometric: bool, image: Image, fitted: &[Tensor<1>]) -> Image {
        let terms = self.free.iter().zip(fitted).filter(|(free, _)| free.term.is_geometric() == geometric);
        terms.fold(image, |image, (free, fitted)| free.term.effect.forward(&free.term.values(fitted), image))
    }

    /// All numbers of each free term, of which `x` are those that are free.
    fn fitted(&self, x: &Tensor<1>) -> Vec<Tensor<1>> {
        let mut from = 0;
        let mut fitted = Vec::with_capacity(self.free.len());
        for free in self.free {
            let mut parts = Vec::new();
            for (i, (_, range)) in free.term.layout().into_iter().enumerate() {
                if free.parameters.contains(&i) {
                    let n = range.len();
                    parts.push(x.clone().slice(s![from..from + n as i64]));
                    from += n as i64;
                } else {
                    let held: Vec<f32> = free.term.fitted[range].iter().map(|x| *x as f32).collect();
                    parts.push(Tensor::from_floats(held.as_slice(), &self.device));
                }
            }
            fitted.push(Tensor::cat(parts, 0));
        }
        fitted
    }

    /// Log-likelihood of each ray of a batch, 0 for those that do not count.
    fn nats(&self, prepared: &Prepared<'_>, x: &Tensor<1>, soften: f64) -> Tensor<3> {
        let fitted = self.fitted(x);
        self.nats_of(prepared, &self.reported(self.moved(prepared, &fitted), &fitted), soften)
    }

    fn nats_of(&self, prepared: &Prepared<'_>, image: &Image, soften: f64) -> Tensor<3> {
        let observed = &prepared.batch.observed;
        let settled = prepared.settled.as_ref();
        let (surface, hit) = (settled.map(|s| &s.surface), settled.map(|s| &s.hit));
        let mut nats = observed.range_m.zeros_like();
        if self.acts_on.range {
            nats = nats + counted(likelihood::range(image, observed, soften), surface);
        }
        if self.acts_on.reflectance {
            nats = nats + counted(likelihood::reflectance(image, observed, soften), surface);
        }
        if self.acts_on.returns {
            nats = nats + counted(likelihood::returns(image, observed), hit);
        }
        nats
    }

    /// Whether each free number moves rays.
    fn moves(&self) -> impl Iterator<Item = bool> {
        self.free.iter().flat_map(|free| vec![free.term.is_geometric(); free.kinds().len()])
    }

    /// The gradient of the numbers that move no rays; rays are moved once for all places at which the others are the same.
    fn gradient_of_still(&self, prepared: &Prepared<'_>, x: &[f64], soften: f64) -> Vec<f64> {
        let moving: Vec<f64> = x.iter().zip(self.moves()).filter(|(_, moves)| *moves).map(|(x, _)| *x).collect();
        let known = || prepared.moved.lock().unwrap_or_else(PoisonError::into_inner);
        let last = known().take();
        let moved = match last {
            Some((at, image)) if at == moving => image,
            _ => self.moved(prepared, &self.fitted(&self.tensor(x))),
        };
        *known() = Some((moving, moved.clone()));
        let tensor = self.tensor(x).require_grad();
        let nats = self.nats_of(prepared, &self.reported(moved, &self.fitted(&tensor)), soften);
        gradient(&tensor, nats)
    }

    fn tensor(&self, x: &[f64]) -> Tensor<1> {
        let x: Vec<f32> = x.iter().map(|x| *x as f32).collect();
        Tensor::from_floats(x.as_slice(), &self.device)
    }

    /// Negative log-likelihood of a batch and its gradient.
    fn of_batch(&self, prepared: &Prepared<'_>, x: &[f64], soften: f64) -> (f64, Vec<f64>) {
        let tensor = self.tensor(x).require_grad();
        let nats = self.nats(prepared, &tensor, soften);
        let value: f64 = per_block(&nats.clone().detach()).iter().sum();
        (-value, gradient(&tensor, nats))
    }

    /// Log-likelihood of each ring, of every so many batches.
    fn by_ring(&self, x: &[f64], every: usize) -> Vec<f64> {
        let x = self.tensor(x);
        let of = |prepared: &Prepared<'_>| {
            let nats = self.nats(prepared, &x, 0.0).sum_dim(2).sum_dim(0);
            nats.into_data().iter::<f64>().collect::<Vec<_>>()
        };
        let sums: Vec<Vec<f64>> = self.batches.par_iter().step_by(every).map(of).collect();
        sums.into_iter().reduce(|a, b| a.iter().zip(b).map(|(a, b)| a + b).collect()).unwrap_or_default()
    }

    /// Tries values of any likely size for what moves rays by one number, or by one a ring, and takes those that suit best, every ring its
    /// own: far along the ground the likelihood has one sharp peak among many.
    /// Whether any was better.
    pub(super) fn scan(&self, x: &mut [f64]) -> bool {
        let mut is_better = false;
        let mut from = 0;
        for free in self.free {
            for (n, extent) in free.groups() {
                let numbers = from..from + n;
                from = numbers.end;
                if free.is_near
                    || !free.term.is_geometric()
                    || !(extent == Extent::PerRing || free.term.fitted.len() == 1)
                {
                    continue;
                }
                let held = x.to_vec();
                let at = |value: f64| {
                    let mut tried = held.clone();
                    tried[numbers.clone()].fill(value);
                    self.of_each(&tried, extent)
                };
                let mut best = self.of_each(x, extent);
                for value in SCANNED.map(|step| f64::from(step) * SCAN_STEP) {
                    for (i, nats) in at(value).into_iter().enumerate() {
                        if nats > best[i] {
                            (best[i], x[numbers.start + i]) = (nats, value);
                            is_better = true;
                        }
                    }
                }
            }
        }
        is_better
    }

    /// Log-likelihood of what each number of a group has a say in.
    fn of_each(&self, x: &[f64], extent: Extent) -> Vec<f64> {
        if extent == Extent::PerRing {
            return self.by_ring(x, 1);
        }
        let rays: usize = self.batches.iter().map(|p| p.batch.observed.range_m.shape().num_elements()).sum();
        vec![self.by_ring(x, (rays / SCANNED_RAYS).max(1)).iter().sum()]
    }
}

/// The gradient of the negative sum.
fn gradient(x: &Tensor<1>, nats: Tensor<3>) -> Vec<f64> {
    let gradients = nats.sum().backward();
    let of = |g: Tensor<1>| g.into_data().iter::<f64>().map(|g| -g).collect();
    x.grad(&gradients).map_or_else(|| vec![0.0; x.dims()[0]], of)
}

/// A function of some of another's numbers, the others held.
pub(super) struct Part<'a> {
    pub(super) whole: &'a dyn Objective,
    pub(super) at: &'a [f64],
    pub(super) numbers: &'a [usize],
}

impl Part<'_> {
    pub(super) fn of(&self, x: &[f64]) -> Vec<f64> {
        self.numbers.iter().map(|i| x[*i]).collect()
    }
}

impl Objective for Part<'_> {
    fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>) {
        let mut whole = self.at.to_vec();
        self.numbers.iter().zip(x).for_each(|(i, x)| whole[*i] = *x);
        let (value, gradient) = self.whole.evaluate(&whole);
        (value, self.of(&gradient))
    }
}

impl Objective for Softened<'_> {
    fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>) {
        let parts: Vec<(f64, Vec<f64>)> =
            self.problem.batches.par_iter().map(|batch| self.problem.of_batch(batch, x, self.soften)).collect();
        let mut sum = (0.0, vec![0.0; x.len()]);
        for (value, gradient) in parts {
            sum.0 += value;
            sum.1.iter_mut().zip(gradient).for_each(|(sum, g)| *sum += g);
        }
        sum
    }

    fn is_dear(&self, number: usize) -> bool {
        self.problem.moves().nth(number).unwrap_or(false)
    }

    fn gradient_of_others(&self, x: &[f64]) -> Vec<f64> {
        let of = |batch| self.problem.gradient_of_still(batch, x, self.soften);
        let parts: Vec<Vec<f64>> = self.problem.batches.par_iter().map(of).collect();
        let sum = |mut sum: Vec<f64>, part: Vec<f64>| {
            sum.iter_mut().zip(part).for_each(|(sum, g)| *sum += g);
            sum
        };
        parts.into_iter().fold(vec![0.0; x.len()], sum)
    }
}
