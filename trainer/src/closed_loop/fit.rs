//! Fits the parameters of some terms of a model by maximum likelihood, the others held.

use std::collections::BTreeMap;
use std::ops::Range;

use burn::tensor::{Device, Tensor, s};
use nalgebra::DMatrix;
use rayon::prelude::*;

use super::data::Batch;
use super::likelihood;
use super::model::{SensorModel, Term};
use super::newton::{self, Effort, Groups, Objective};
use crate::effects::{ActsOn, Extent, Image, Kind};

/// To find the way through widened normals.
const ON_THE_WAY: Effort = Effort { steps: 3, tolerance: 1.0 };

/// How a fit is done.
#[derive(Clone, Copy, Debug)]
pub struct Manner<'a> {
    /// By how much the normals of the likelihood are widened, one search after the other, so that a start that is far off finds its way.
    pub widths: &'a [f64],
    /// How far the last search, which is exact, goes.
    pub effort: Effort,
    /// Hessian of the first free term's numbers at the start, if it is known.
    pub known: Option<&'a DMatrix<f64>>,
}

impl Manner<'_> {
    /// To find out whether an effect is worth anything.
    pub const TRIAL: Self = Self { widths: &[], effort: Effort { steps: 30, tolerance: 0.3 }, known: None };

    /// To know the values.
    pub const EXACT: Self = Self { widths: &[], effort: Effort { steps: 60, tolerance: 0.02 }, known: None };
}

/// A term, and which of its numbers are free.
#[derive(Clone, Debug)]
pub struct Free {
    /// The term, where the fit starts.
    pub term: Term,
    /// The parameters that are free, by number.
    pub parameters: Vec<usize>,
}

/// Sectors that a frame's azimuths are divided into: rays of different sectors are taken as independent.
pub const SECTORS: usize = 8;

/// Log-likelihoods of one block (a sector of a frame) in nats, summed over its rays.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// Scene of the frame.
    pub scene: usize,
    /// Of the ranges.
    pub range: f64,
    /// Of the reflectances.
    pub reflectance: f64,
    /// Of return or no return.
    pub returns: f64,
}

/// What a fit looks at.
#[derive(Clone, Copy, Debug)]
pub struct On<'a> {
    /// The scans.
    pub batches: &'a [&'a Batch],
    /// Their channels.
    pub channels: ActsOn,
    /// Their rays; settled ones can be told only where the free terms move none.
    pub rays: Rays,
}

/// A fit's end.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The terms that were free, with the values found, in their order.
    pub terms: Vec<Term>,
    /// Log-likelihood in nats, of the likelihoods that the free terms act on.
    pub log_likelihood: f64,
}

impl Score {
    /// Sum of the likelihoods that something acts on.
    pub fn of(&self, acts_on: ActsOn) -> f64 {
        let part = |on: bool, x: f64| if on { x } else { 0.0 };
        part(acts_on.range, self.range)
            + part(acts_on.reflectance, self.reflectance)
            + part(acts_on.returns, self.returns)
    }

    /// Both together; the scene is no longer one.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            scene: 0,
            range: self.range + other.range,
            reflectance: self.reflectance + other.reflectance,
            returns: self.returns + other.returns,
        }
    }

    /// All of it.
    pub fn total(&self) -> f64 {
        self.of(ActsOn::ALL)
    }
}

impl Free {
    /// All numbers of a term that a fit can move.
    pub fn all(term: Term) -> Self {
        let moves = |i: &usize| term.parameters[*i].kind != Kind::Found;
        let parameters = (0..term.parameters.len()).filter(moves).collect();
        Self { term, parameters }
    }

    /// The numbers of the noise floor that belong to these likelihoods.
    pub fn noise(term: Term, acts_on: ActsOn) -> Self {
        let belongs = |i: &usize| match i {
            0 | 3 => acts_on.range,
            1 | 4 => acts_on.reflectance,
            _ => acts_on.returns,
        };
        let parameters = (0..term.parameters.len()).filter(belongs).collect();
        Self { term, parameters }
    }

    /// Lengths of its parameters, and what each is over.
    fn groups(&self) -> Vec<(usize, Extent)> {
        let layout = self.term.layout();
        self.parameters.iter().map(|i| (layout[*i].1.len(), layout[*i].0.extent)).collect()
    }

    /// The kind of each of its numbers.
    fn kinds(&self) -> Vec<Kind> {
        let layout = self.term.layout();
        self.parameters.iter().flat_map(|i| vec![layout[*i].0.kind; layout[*i].1.len()]).collect()
    }

    fn ranges(&self) -> Vec<Range<usize>> {
        let layout = self.term.layout();
        self.parameters.iter().map(|i| layout[*i].1.clone()).collect()
    }
}

/// Which rays count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rays {
    /// All of them, as where rays are moved.
    All,
    /// Those of which the model's moved rays leave no doubt what they hit, as for everything else: see [`Image::settled`].
    Settled,
}

impl Rays {
    /// Those that say whether a model needs an effect.
    pub fn of(term: &Term) -> Self {
        if term.is_geometric() { Self::All } else { Self::Settled }
    }
}

/// Log-likelihoods under a model, block by block in the order of the batches.
pub fn score(model: &SensorModel, batches: &[&Batch], rays: Rays) -> Vec<Score> {
    let of = |batch: &&Batch| {
        let image = model.forward(batch.image.clone());
        let settled = if rays == Rays::Settled { image.settled() } else { None };
        let sums = |nats: Tensor<3>| per_block(&counted(nats, settled.as_ref()));
        let range = sums(likelihood::range(&image, &batch.observed, 0.0));
        let reflectance = sums(likelihood::reflectance(&image, &batch.observed, 0.0));
        let returns = sums(likelihood::returns(&image, &batch.observed));
        (0..range.len())
            .map(|i| Score { scene: batch.scene, range: range[i], reflectance: reflectance[i], returns: returns[i] })
            .collect::<Vec<_>>()
    };
    batches.par_iter().map(of).collect::<Vec<_>>().concat()
}

/// Fits the free terms. A free term that the model has is refitted (it is known by its name); any other is added to it.
pub fn fit(model: &SensorModel, free: &[Free], on: &On<'_>, manner: Manner<'_>) -> Fitted {
    let problem = Problem::new(model, free, on);
    let mut x = problem.start();
    // Under widened normals the means can be found, but every spread seems too large: spreads wait.
    let means = problem.means();
    for soften in manner.widths.iter().copied().filter(|_| !means.is_empty()) {
        let part = Part { whole: &Softened { problem: &problem, soften }, at: &x, numbers: &means };
        let found = problem.groups_of_means().minimise(&part, &part.of(&x), ON_THE_WAY, None).x;
        means.iter().zip(found).for_each(|(i, found)| x[*i] = found);
    }
    let exact = Softened { problem: &problem, soften: 0.0 };
    let minimum = problem.groups().minimise(&exact, &x, manner.effort, manner.known);
    Fitted { terms: problem.terms(&minimum.x), log_likelihood: -minimum.value }
}

/// Hessian of the negative log-likelihood over the numbers of the free terms, where they are.
pub fn hessian(model: &SensorModel, free: &[Free], on: &On<'_>) -> DMatrix<f64> {
    let problem = Problem::new(model, free, on);
    problem.groups().curvature(&Softened { problem: &problem, soften: 0.0 }, &problem.start())
}

/// Standard errors of every number of the free terms, which have been fitted, in a fit's units; 0 for numbers that are held.
pub fn stderr(model: &SensorModel, free: &[Free], on: &On<'_>) -> Vec<Vec<f64>> {
    let problem = Problem::new(model, free, on);
    let x = problem.start();
    let hessian = problem.groups().curvature(&Softened { problem: &problem, soften: 0.0 }, &x);
    let found = newton::stderr(&hessian, &problem.gradients_by_scene(&x));
    let mut next = found.iter();
    free.iter()
        .map(|free| {
            let mut of = vec![0.0; free.term.fitted.len()];
            for i in free.ranges().into_iter().flatten() {
                of[i] = *next.next().unwrap_or_else(|| unreachable!("one error a number"));
            }
            of
        })
        .collect()
}

/// What is fitted to what; everything that does not change is worked out once.
struct Problem<'a> {
    held_last: Vec<&'a Term>,
    free: &'a [Free],
    acts_on: ActsOn,
    batches: Vec<Prepared<'a>>,
    device: Device,
}

struct Prepared<'a> {
    batch: &'a Batch,
    image: Image,
    /// 1 where rays count; `None` where all do.
    settled: Option<Tensor<3>>,
}

struct Softened<'a> {
    problem: &'a Problem<'a>,
    soften: f64,
}

impl<'a> Problem<'a> {
    fn new(model: &'a SensorModel, free: &'a [Free], on: &On<'a>) -> Self {
        let is_free = |term: &&Term| free.iter().any(|f| f.term.name() == term.name());
        let held: Vec<&Term> = model.terms.iter().filter(|t| !is_free(t)).collect();
        let (moving, other): (Vec<&Term>, Vec<&Term>) = held.into_iter().partition(|t| t.is_geometric());
        let moves = free.iter().any(|f| f.term.is_geometric());
        let prepare = |batch: &'a Batch| {
            let image = moving.iter().fold(batch.image.clone(), |image, term| term.forward(image));
            if moves {
                return Prepared { batch, image, settled: None };
            }
            let image = image.resample();
            let settled = if on.rays == Rays::Settled { image.settled() } else { None };
            Prepared { batch, image: other.iter().fold(image, |image, term| term.forward(image)), settled }
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
    fn start(&self) -> Vec<f64> {
        self.free.iter().flat_map(|f| f.ranges().into_iter().flat_map(|r| f.term.fitted[r].to_vec())).collect()
    }

    fn groups(&self) -> Groups {
        Groups::new(self.free.iter().flat_map(Free::groups))
    }

    /// Which of the numbers are means rather than spreads or probabilities.
    fn means(&self) -> Vec<usize> {
        let kinds = self.free.iter().flat_map(Free::kinds).enumerate();
        kinds.filter(|(_, kind)| *kind == Kind::Free).map(|(i, _)| i).collect()
    }

    fn groups_of_means(&self) -> Groups {
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
    fn gradients_by_scene(&self, x: &[f64]) -> Vec<Vec<f64>> {
        let parts: Vec<(usize, Vec<f64>)> =
            self.batches.par_iter().map(|b| (b.batch.scene, self.of_batch(b, x, 0.0).1)).collect();
        let mut scenes: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for (scene, gradient) in parts {
            let sum = scenes.entry(scene).or_insert_with(|| vec![0.0; x.len()]);
            sum.iter_mut().zip(gradient).for_each(|(sum, g)| *sum += g);
        }
        scenes.into_values().collect()
    }

    fn terms(&self, x: &[f64]) -> Vec<Term> {
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

    /// The image with the free terms at these numbers, `fitted` being a tensor a term.
    fn image(&self, prepared: &Prepared<'_>, fitted: &[Tensor<1>]) -> Image {
        let act = |image: Image, (free, fitted): (&Free, &Tensor<1>)| {
            free.term.effect.forward(&free.term.values(fitted), image)
        };
        let with =
            |geometric: bool| self.free.iter().zip(fitted).filter(move |(f, _)| f.term.is_geometric() == geometric);
        let image = with(true).fold(prepared.image.clone(), act).resample();
        let image = self.held_last.iter().fold(image, |image, term| term.forward(image));
        with(false).fold(image, act)
    }

    /// Negative log-likelihood of a batch and its gradient.
    fn of_batch(&self, prepared: &Prepared<'_>, x: &[f64], soften: f64) -> (f64, Vec<f64>) {
        let x: Vec<f32> = x.iter().map(|x| *x as f32).collect();
        let x = Tensor::<1>::from_floats(x.as_slice(), &self.device).require_grad();
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
        let image = self.image(prepared, &fitted);
        let observed = &prepared.batch.observed;
        let mut parts = Vec::new();
        if self.acts_on.range {
            parts.push(likelihood::range(&image, observed, soften));
        }
        if self.acts_on.reflectance {
            parts.push(likelihood::reflectance(&image, observed, soften));
        }
        if self.acts_on.returns {
            parts.push(likelihood::returns(&image, observed));
        }
        let Some(total) = parts.into_iter().reduce(|a, b| a + b) else { return (0.0, vec![0.0; x.dims()[0]]) };
        let total = counted(total, prepared.settled.as_ref());
        let value: f64 = per_block(&total.clone().detach()).iter().sum();
        let gradients = total.sum().backward();
        let gradient = x
            .grad(&gradients)
            .map_or_else(|| vec![0.0; x.dims()[0]], |g| g.into_data().iter::<f64>().map(|g| -g).collect());
        (-value, gradient)
    }
}

/// A function of some of another's numbers, the others held.
struct Part<'a> {
    whole: &'a dyn Objective,
    at: &'a [f64],
    numbers: &'a [usize],
}

impl Part<'_> {
    fn of(&self, x: &[f64]) -> Vec<f64> {
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
}

/// Log-likelihoods of the rays that count, 0 for the others.
fn counted(nats: Tensor<3>, settled: Option<&Tensor<3>>) -> Tensor<3> {
    match settled {
        None => nats,
        Some(settled) => nats * settled.clone(),
    }
}

/// Sums over rays, sector by sector of each frame; columns in the tensor's precision, their sum in double.
fn per_block(nats: &Tensor<3>) -> Vec<f64> {
    let [_, _, columns] = nats.dims();
    let sums: Vec<f64> = nats.clone().sum_dim(1).into_data().iter::<f64>().collect();
    let block = |frame: &[f64]| frame.chunks(columns.div_ceil(SECTORS)).map(|c| c.iter().sum()).collect::<Vec<f64>>();
    sums.chunks(columns).flat_map(block).collect()
}
