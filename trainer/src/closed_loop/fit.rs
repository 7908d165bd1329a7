//! Fits the parameters of some terms of a model by maximum likelihood, the others held.

use std::ops::Range;

use nalgebra::DMatrix;

use super::data::Batch;
use super::model::{SensorModel, Term};
use super::newton::{self, Effort};
use super::problem::{Part, Problem, Softened};
use super::score::Scope;
use crate::effects::{ActsOn, Extent, Kind};

/// To find the way through widened normals.
const ON_THE_WAY: Effort = Effort { steps: 3, tolerance: 1.0, share: 0.0, target: f64::INFINITY };

/// How a fit is done.
#[derive(Clone, Copy, Debug)]
pub struct Manner<'a> {
    /// By how much the normals of the likelihood are widened, one search after the other, so that a start that is far off finds its way.
    pub widths: &'a [f64],
    /// Whether what moves rays by one number, or by one a ring, is tried at many values: at the end of the way through
    /// widened normals, and where the last search goes as far as it can, once more after it.
    pub scan: bool,
    /// How far the last search, which is exact, goes.
    pub effort: Effort,
    /// Hessian of the first free numbers, or of all, at the start, if it is known.
    pub known: Option<&'a DMatrix<f64>>,
}

impl Manner<'_> {
    /// To find out whether an effect is worth a trial.
    pub const GLANCE: Self = Self { effort: Effort { share: 0.01, ..Self::TRIAL.effort }, ..Self::TRIAL };

    /// To find out what an effect is worth.
    pub const TRIAL: Self = Self {
        widths: &[],
        scan: false,
        effort: Effort { steps: 30, tolerance: 0.3, share: 0.0, target: f64::INFINITY },
        known: None,
    };

    /// To know the values.
    pub const EXACT: Self =
        Self { scan: true, effort: Effort { steps: 60, tolerance: 0.02, ..Self::TRIAL.effort }, ..Self::TRIAL };
}

/// A term, and which of its numbers are free.
#[derive(Clone, Debug)]
pub struct Free {
    /// The term, where the fit starts.
    pub term: Term,
    /// The parameters that are free, by number.
    pub parameters: Vec<usize>,
    /// Whether it is near its place already, so that a scan need not look for it.
    pub is_near: bool,
}

/// What a fit looks at.
#[derive(Clone, Copy, Debug)]
pub struct On<'a> {
    /// The scans.
    pub batches: &'a [&'a Batch],
    /// Their channels.
    pub channels: ActsOn,
    /// Their rays; settled ones can be told only where the free terms move none.
    pub scope: Scope,
}

/// A fit's end.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The terms that were free, with the values found, in their order.
    pub terms: Vec<Term>,
    /// Log-likelihood in nats, of the likelihoods that the free terms act on.
    pub log_likelihood: f64,
    /// Hessian of its negative over the free numbers, as far as the fit knows it.
    pub hessian: DMatrix<f64>,
}

impl Free {
    /// All numbers of a term that a fit can move.
    pub fn all(term: Term) -> Self {
        let moves = |i: &usize| term.parameters[*i].kind != Kind::Found;
        let parameters = (0..term.parameters.len()).filter(moves).collect();
        Self { term, parameters, is_near: false }
    }

    /// The same of a term that is near its place already.
    pub fn near(term: Term) -> Self {
        Self { is_near: true, ..Self::all(term) }
    }

    /// The numbers of the noise floor that belong to these likelihoods.
    pub fn noise(term: Term, acts_on: ActsOn) -> Self {
        let belongs = |i: &usize| match i {
            0 | 3 => acts_on.range,
            1 | 4 => acts_on.reflectance,
            _ => acts_on.returns,
        };
        let parameters = (0..term.parameters.len()).filter(belongs).collect();
        Self { term, parameters, is_near: true }
    }

    /// Lengths of its parameters, and what each is over.
    pub(super) fn groups(&self) -> Vec<(usize, Extent)> {
        let layout = self.term.layout();
        self.parameters.iter().map(|i| (layout[*i].1.len(), layout[*i].0.extent)).collect()
    }

    /// The kind of each of its numbers.
    pub(super) fn kinds(&self) -> Vec<Kind> {
        let layout = self.term.layout();
        self.parameters.iter().flat_map(|i| vec![layout[*i].0.kind; layout[*i].1.len()]).collect()
    }

    pub(super) fn ranges(&self) -> Vec<Range<usize>> {
        let layout = self.term.layout();
        self.parameters.iter().map(|i| layout[*i].1.clone()).collect()
    }
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
    if manner.scan && !manner.widths.is_empty() {
        problem.scan(&mut x);
    }
    let mut minimum = problem.groups().minimise(&exact, &x, manner.effort, manner.known);
    // Now that the noise is known, peaks are sharper.
    if manner.scan && manner.effort.share == 0.0 && problem.scan(&mut minimum.x) {
        minimum = problem.groups().minimise(&exact, &minimum.x, manner.effort, None);
    }
    Fitted { terms: problem.terms(&minimum.x), log_likelihood: -minimum.value, hessian: minimum.hessian }
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
