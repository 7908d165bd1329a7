//! Newton's method with second derivatives from differences of automatic gradients.
//!
//! Parameters come in groups: numbers within a group do not interact (a ring's offset has no say in another ring's pixels), so one
//! difference along a whole group gives a column of the Hessian for each of them at once: as many gradients as groups, not as numbers.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use crate::effects::Extent;

/// Longest and shortest step of the differences, in units in which parameters have a size of about 1. Shorter ones drown in rounding.
const STEPS: (f64, f64) = (0.02, 1e-4);

/// Step of the differences in standard errors, as far as they are known: a likelihood is a parabola over a few of them, not over many.
const STEP_ERRORS: f64 = 2.0;

/// Longest step of the differences at the end of a search.
const FARTHEST: f64 = 1.0;

/// A step that is this many times too long has to be taken again.
const FAR_TOO_LONG: f64 = 4.0;

/// Longest step along a direction, in the same units.
const LONGEST: f64 = 10.0;

/// How often a step is shortened.
const ATTEMPTS: usize = 5;

/// How many times what a step promises a search may still gain.
const HOPE: f64 = 4.0;

/// Share of what a step promised that it has to keep for the second derivatives to be worth updating rather than working out anew.
const KEPT: f64 = 0.5;

/// A function and its gradient.
pub trait Objective {
    /// Value and gradient at `x`.
    fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>);

    /// Whether this number is dear: while it stays, the gradient of those that are not is had for far less.
    fn is_dear(&self, _number: usize) -> bool {
        false
    }

    /// The gradient at `x` of the numbers that are not dear; the others' entries mean nothing.
    fn gradient_of_others(&self, x: &[f64]) -> Vec<f64> {
        self.evaluate(x).1
    }
}

/// How much trouble a search takes.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Most steps.
    pub steps: usize,
    /// By how much a step has to promise to lower the value to be taken.
    pub tolerance: f64,
    /// The same as a share of what the search has gained so far.
    pub share: f64,
    /// The value that is to be reached: a search that cannot hope to is given up.
    pub target: f64,
}

/// Where a search ended.
#[derive(Clone, Debug)]
pub struct Minimum {
    /// The place.
    pub x: Vec<f64>,
    /// The value.
    pub value: f64,
    /// The Hessian, as far as the search knows it.
    pub hessian: DMatrix<f64>,
}

/// The groups that the numbers of `x` fall into, one after the other.
#[derive(Clone, Debug)]
pub struct Groups(Vec<Group>);

/// Numbers that do not interact with one another.
#[derive(Clone, Debug)]
struct Group {
    numbers: std::ops::Range<usize>,
    /// What the numbers are counted by. Of two groups over the same, each number interacts with its like alone; over different things
    /// (rings and knots), the interaction of two groups is not looked at, which costs a search steps and no exactness at its end.
    over: Extent,
}

impl Groups {
    /// Groups of these lengths, and what each is over.
    pub fn new(groups: impl IntoIterator<Item = (usize, Extent)>) -> Self {
        let mut from = 0;
        let group = |(n, over)| {
            from += n;
            Group { numbers: from - n..from, over }
        };
        Self(groups.into_iter().map(group).collect())
    }

    /// The Hessian at `x`, where the gradient is `gradient`, by differences over `steps`, which are then fitted to it.
    fn hessian(
        &self,
        objective: &dyn Objective,
        x: &[f64],
        gradient: &[f64],
        steps: &mut [f64],
        known: Option<&DMatrix<f64>>,
    ) -> DMatrix<f64> {
        let hessian = self.differences(objective, x, gradient, steps, known);
        let fitting: Vec<f64> = hessian.diagonal().iter().map(|curvature| fitting(*curvature)).collect();
        let too_long = steps.iter().zip(&fitting).any(|(step, fitting)| *step > FAR_TOO_LONG * fitting);
        steps.copy_from_slice(&fitting);
        if too_long { self.differences(objective, x, gradient, steps, known) } else { hessian }
    }

    fn differences(
        &self,
        objective: &dyn Objective,
        x: &[f64],
        gradient: &[f64],
        steps: &[f64],
        known: Option<&DMatrix<f64>>,
    ) -> DMatrix<f64> {
        let n = x.len();
        let n_known = known.map_or(0, DMatrix::nrows);
        let mut hessian = DMatrix::zeros(n, n);
        // Two numbers' entry is found when either moves, so the dear ones' alone would do; but not if several of them move at once.
        let is_dear = |group: &Group| objective.is_dear(group.numbers.start);
        let leave_dear = self.0.iter().all(|group| !is_dear(group) || group.over == Extent::One);
        let differences: Vec<Vec<f64>> = self
            .0
            .iter()
            .map(|group| {
                if group.numbers.end <= n_known {
                    return vec![];
                }
                let mut moved = x.to_vec();
                group.numbers.clone().for_each(|i| moved[i] += steps[i]);
                let leave = leave_dear && !is_dear(group);
                let there = if leave { objective.gradient_of_others(&moved) } else { objective.evaluate(&moved).1 };
                there.iter().zip(gradient).map(|(there, here)| there - here).collect()
            })
            .collect();
        for (a, d) in self.0.iter().zip(&differences).filter(|(_, d)| !d.is_empty()) {
            for b in &self.0 {
                let (i, j) = (&a.numbers, &b.numbers);
                if leave_dear && is_dear(b) && !is_dear(a) {
                    continue;
                }
                if leave_dear && is_dear(a) && !is_dear(b) && j.end > n_known {
                    for j in j.clone() {
                        let entry = d[j] / steps[i.start];
                        (hessian[(i.start, j)], hessian[(j, i.start)]) = (entry, entry);
                    }
                    continue;
                }
                if j.end <= n_known {
                    // What is known does not move; its interaction with several numbers that move at once is not looked at.
                    if a.over == Extent::One {
                        let entry = d[j.start] / steps[i.start];
                        (hessian[(i.start, j.start)], hessian[(j.start, i.start)]) = (entry, entry);
                    }
                    continue;
                }
                match (a.over, b.over) {
                    // Two single numbers: each moves once, and the two differences are averaged below.
                    (Extent::One, Extent::One) => hessian[(i.start, j.start)] = d[j.start] / steps[i.start],
                    (Extent::One, _) => j.clone().for_each(|j| {
                        let entry = d[j] / steps[i.start];
                        (hessian[(i.start, j)], hessian[(j, i.start)]) = (entry, entry);
                    }),
                    // Its column is found when the single number moves.
                    (_, Extent::One) => {}
                    (Extent::PerRing, Extent::PerRing) => {
                        i.clone().zip(j.clone()).for_each(|(i, j)| hessian[(j, i)] = d[j] / steps[i]);
                    }
                    _ if i == j => i.clone().for_each(|i| hessian[(i, i)] = d[i] / steps[i]),
                    _ => {}
                }
            }
        }
        if let Some(known) = known {
            hessian.view_mut((0, 0), (n_known, n_known)).copy_from(known);
        }
        (&hessian + hessian.transpose()) * 0.5
    }

    /// The Hessian at `x`, from differences over steps that fit it, forwards and backwards.
    pub fn curvature(&self, objective: &dyn Objective, x: &[f64]) -> DMatrix<f64> {
        let (_, gradient) = objective.evaluate(x);
        let mut steps = vec![STEPS.0; x.len()];
        let rough = self.hessian(objective, x, &gradient, &mut steps, None);
        // A number that is hardly known is known by how the value changes far away, not by the unevenness here.
        for (i, step) in steps.iter_mut().enumerate() {
            *step = (STEP_ERRORS / rough[(i, i)].max(1e-12).sqrt()).clamp(*step, FARTHEST);
        }
        let forwards = self.differences(objective, x, &gradient, &steps, None);
        for step in &mut steps {
            *step = -*step;
        }
        (forwards + self.differences(objective, x, &gradient, &steps, None)) * 0.5
    }

    /// Searches a minimum from `x`, until a step promises too little to be worth the effort.
    ///
    /// The Hessian is worked out where the search starts and wherever it proves wrong, and updated between (Broyden, Fletcher, Goldfarb
    /// and Shanno: Nocedal and Wright, Numerical Optimization, 2006, section 6.1).
    ///
    /// The Hessian of the first numbers, or of all, may be known where the search starts.
    pub fn minimise(
        &self,
        objective: &dyn Objective,
        x: &[f64],
        effort: Effort,
        known: Option<&DMatrix<f64>>,
    ) -> Minimum {
        let mut x = x.to_vec();
        let (mut value, mut gradient) = objective.evaluate(&x);
        let mut reach = LONGEST;
        let mut lengths = vec![STEPS.0; x.len()];
        if let Some(known) = known {
            lengths
                .iter_mut()
                .zip(known.diagonal().iter())
                .for_each(|(length, curvature)| *length = fitting(*curvature));
        }
        let first = self.hessian(objective, &x, &gradient, &mut lengths, known);
        let mut hessian = positive(&first);
        let mut trust = Trust::Fresh;
        let start = value;
        for _ in 0..effort.steps {
            let newton = Newton::new(&hessian, &gradient);
            let enough = effort.tolerance.max(effort.share * (start - value));
            let promised = newton.step(LONGEST).1;
            if promised < enough || value - HOPE * promised > effort.target {
                break;
            }
            if trust == Trust::Lost {
                hessian = positive(&self.hessian(objective, &x, &gradient, &mut lengths, None));
                trust = Trust::Fresh;
                continue;
            }
            let was = std::mem::replace(&mut trust, Trust::Lost);
            let mut moved = false;
            for attempt in 0..ATTEMPTS {
                let (step, promised) = newton.step(reach);
                if promised < enough {
                    break;
                }
                let there: Vec<f64> = x.iter().zip(step.iter()).map(|(x, d)| x + d).collect();
                let (new_value, new_gradient) = objective.evaluate(&there);
                if new_value.is_finite() && new_value < value {
                    let expected = promised - 0.5 * step.dot(&(&hessian * &step));
                    if attempt == 0 && value - new_value > KEPT * expected {
                        trust = Trust::Updated;
                    }
                    let change =
                        DVector::from_iterator(x.len(), new_gradient.iter().zip(&gradient).map(|(a, b)| a - b));
                    update(&mut hessian, &step, &change);
                    (x, value, gradient) = (there, new_value, new_gradient);
                    reach = (2.0 * reach).min(LONGEST);
                    moved = true;
                    break;
                }
                reach = 0.25 * reach.min(newton.longest());
            }
            if !moved && was == Trust::Fresh {
                break;
            }
        }
        Minimum { x, value, hessian }
    }
}

/// Step of the differences that fits a curvature.
fn fitting(curvature: f64) -> f64 {
    if curvature > 0.0 { (STEP_ERRORS / curvature.sqrt()).clamp(STEPS.1, STEPS.0) } else { STEPS.0 }
}

/// How far a Hessian can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trust {
    /// It was worked out here.
    Fresh,
    /// It was updated along steps that kept what they promised.
    Updated,
    /// A step did not.
    Lost,
}

/// Newton's step, along each eigenvector of the Hessian by itself.
struct Newton {
    directions: DMatrix<f64>,
    along: DVector<f64>,
    gradient: DVector<f64>,
}

impl Newton {
    fn new(hessian: &DMatrix<f64>, gradient: &[f64]) -> Self {
        let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(hessian.clone());
        let gradient = DVector::from_column_slice(gradient);
        let slope = eigenvectors.transpose() * &gradient;
        let along = slope.zip_map(&eigenvalues, |slope, curvature| -slope / curvature.max(1e-12));
        Self { directions: eigenvectors, along, gradient }
    }

    /// The step, no longer than `reach` in any direction, so that one that is flat does not hold back those that are known; and by how
    /// much the gradient promises to lower the value.
    fn step(&self, reach: f64) -> (DVector<f64>, f64) {
        let step = &self.directions * self.along.map(|along| along.clamp(-reach, reach));
        let promised = -self.gradient.dot(&step);
        (step, promised)
    }

    fn longest(&self) -> f64 {
        self.along.amax()
    }
}

/// The same curvature upwards in every direction, and some in each.
fn positive(hessian: &DMatrix<f64>) -> DMatrix<f64> {
    let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(hessian.clone());
    let least = 1e-7 * eigenvalues.amax().max(1e-12);
    let upwards = eigenvalues.map(|curvature: f64| curvature.abs().max(least));
    &eigenvectors * DMatrix::from_diagonal(&upwards) * eigenvectors.transpose()
}

/// What a step and the change of the gradient along it say of the Hessian.
fn update(hessian: &mut DMatrix<f64>, step: &DVector<f64>, change: &DVector<f64>) {
    let bent = &*hessian * step;
    let (along, before) = (change.dot(step), step.dot(&bent));
    if along > 1e-3 * before {
        *hessian += change * change.transpose() / along - &bent * bent.transpose() / before;
    }
}

/// Standard errors of numbers where a negative log-likelihood has this Hessian: the larger of what the curvature says, which trusts the
/// model, and of what the scenes' gradients say, which does not (H⁻¹ Σ g gᵀ H⁻¹, clustered by scene: Huber 1967, Liang and Zeger 1986).
pub fn stderr(hessian: &DMatrix<f64>, gradients: &[Vec<f64>]) -> Vec<f64> {
    let n = hessian.nrows();
    let eigen = SymmetricEigen::new(hessian.clone());
    // At a minimum only rounding, or numbers whose interaction was not looked at, make a curvature negative: its size is what is known.
    let floor = 1e-9 * eigen.eigenvalues.amax().max(1e-12);
    let inverse = DMatrix::from_fn(n, n, |i, j| {
        let along =
            |k: usize| eigen.eigenvectors[(i, k)] * eigen.eigenvectors[(j, k)] / eigen.eigenvalues[k].abs().max(floor);
        (0..n).map(along).sum::<f64>()
    });
    let moves: Vec<DVector<f64>> = gradients.iter().map(|g| &inverse * DVector::from_column_slice(g)).collect();
    let scenes = moves.len() as f64;
    (0..n)
        .map(|i| {
            let trusting = inverse[(i, i)].max(0.0);
            let clustered = if moves.len() < 3 {
                0.0
            } else {
                moves.iter().map(|m| m[i] * m[i]).sum::<f64>() * scenes / (scenes - 1.0)
            };
            trusting.max(clustered).sqrt()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A parabola in two numbers that interact, and a third that is curved otherwise.
    struct Bowl;

    impl Objective for Bowl {
        fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>) {
            let (a, b, c) = (x[0] - 1.0, x[1] + 2.0, x[2] - 0.5);
            let value = 50.0 * a * a + 30.0 * a * b + 20.0 * b * b + 10.0 * (c.cosh() - 1.0);
            (value, vec![100.0 * a + 30.0 * b, 30.0 * a + 40.0 * b, 10.0 * c.sinh()])
        }
    }

    /// The same, whose first number is dear.
    struct DearBowl;

    impl Objective for DearBowl {
        fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>) {
            Bowl.evaluate(x)
        }

        fn is_dear(&self, number: usize) -> bool {
            number == 0
        }

        fn gradient_of_others(&self, x: &[f64]) -> Vec<f64> {
            let mut gradient = Bowl.evaluate(x).1;
            gradient[0] = f64::NAN;
            gradient
        }
    }

    #[test]
    fn a_curvature_is_the_same_where_a_number_is_dear() {
        let groups = Groups::new([(1, Extent::One), (1, Extent::One), (1, Extent::One)]);
        let x = [1.0, -2.0, 0.5];
        let difference = groups.curvature(&Bowl, &x) - groups.curvature(&DearBowl, &x);
        assert!(difference.amax() < 1e-6, "{difference}");
        // Where the dear numbers are several that move at once, nothing can be saved.
        let rings = Groups::new([(2, Extent::PerRing), (1, Extent::One)]);
        let difference = rings.curvature(&Bowl, &x) - rings.curvature(&DearBowl, &x);
        assert!(difference.amax() < 1e-6, "{difference}");
    }

    fn to_the_end(target: f64) -> Effort {
        Effort { steps: 30, tolerance: 1e-9, share: 0.0, target }
    }

    #[test]
    fn a_search_is_given_up_where_its_target_is_out_of_reach_and_only_there() {
        let groups = Groups::new([(1, Extent::One), (1, Extent::One), (1, Extent::One)]);
        let start = [1.1, -2.1, 0.6];
        let (value, _) = Bowl.evaluate(&start);
        let hopeless = groups.minimise(&Bowl, &start, to_the_end(-10.0 * value), None);
        assert_eq!((hopeless.x.as_slice(), hopeless.value), (start.as_slice(), value));
        // The bottom is at 0: within four times what a step promises, which is twice what it brings.
        let hopeful = groups.minimise(&Bowl, &start, to_the_end(0.0), None);
        assert!(hopeful.value < 1e-6, "{}", hopeful.value);
    }

    #[test]
    fn a_search_finds_the_bottom_and_its_curvature() {
        let groups = Groups::new([(1, Extent::One), (1, Extent::One), (1, Extent::One)]);
        let found = groups.minimise(&Bowl, &[5.0, 5.0, 3.0], to_the_end(f64::INFINITY), None);
        for (found, expected) in found.x.iter().zip([1.0, -2.0, 0.5]) {
            assert!((found - expected).abs() < 1e-4, "{found}");
        }
        let hessian = groups.curvature(&Bowl, &found.x);
        for ((i, j), expected) in [((0, 0), 100.0), ((0, 1), 30.0), ((1, 1), 40.0), ((2, 2), 10.0), ((0, 2), 0.0)] {
            // Over two standard errors a hyperbolic cosine is 7 % steeper than at its bottom.
            assert!((hessian[(i, j)] - expected).abs() < 0.07 * expected + 0.1, "{hessian}");
        }
        assert!(found.value < 1e-6, "{}", found.value);
    }
}
