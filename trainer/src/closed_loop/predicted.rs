//! What a model says of every ray, beside what was measured, as plain numbers.

use burn::tensor::Tensor;

use super::data::Batch;

use super::model::SensorModel;
use crate::effects::Image;
use crate::effects::draw::cumulative;

/// Distance to a moved ray's second surface up to which it makes no difference, beside the noise: a bend, not an edge.
const LEAST_STEP_M: f32 = 0.1;

/// Probability below which a moved ray's second surface does not count.
const LEAST_WEIGHT: f32 = 0.02;

/// Standard deviation that stands for a doubt of half width 1.
const DOUBT_SIGMA: f32 = 2.0;

/// The rays of a batch, each list `[frame, ring, column]`, row-major.
#[derive(Clone, Debug)]
pub struct Predicted {
    /// Number of the batch's scene.
    pub scene: usize,
    /// Numbers of its frames.
    pub frames: Vec<usize>,
    /// Numbers of rings and columns.
    pub size: [usize; 2],
    /// Probability that the ray hits a surface.
    pub hit: Vec<f32>,
    /// Mean range of a return of that surface, m.
    pub range_m: Vec<f32>,
    /// Its standard deviation, m.
    pub sigma_m: Vec<f32>,
    /// Mean reflectance, held to 0–1 as reports are.
    pub reflectance: Vec<f32>,
    /// Median reflectance, held to 0–1: what a scan without noise shows.
    pub median_reflectance: Vec<f32>,
    /// Standard deviation of the reflectance.
    pub reflectance_sigma: Vec<f32>,
    /// Mean distance of a reported reflectance from its median: the least error that any model could have.
    pub least_reflectance_error: Vec<f32>,
    /// Probability that the ray is reported.
    pub reported: Vec<f32>,
    /// Probability of a return that is none of the surface's: an extra one, or one between two surfaces.
    pub extra: Vec<f32>,
    /// Standardised range residual beyond which a return is likelier to be an outlier than one of the surface's.
    pub gate: Vec<f32>,
    /// Whether the image knows what the ray hits: it was not moved, or it hits a surface whose plane is known, with no second surface
    /// beside it, as there is where a moved ray passes an edge.
    pub certain: Vec<bool>,
    /// Measured range, m; 0 where there is no return.
    pub measured_range_m: Vec<f32>,
    /// Measured reflectance.
    pub measured_reflectance: Vec<f32>,
}

impl Predicted {
    /// What a model says of a batch.
    pub fn new(model: &SensorModel, batch: &Batch) -> Self {
        Self::of(&model.forward(batch.image.clone()), batch)
    }

    /// The same, of the image that the model made of the batch.
    pub fn of(image: &Image, batch: &Batch) -> Self {
        let dims = batch.observed.range_m.dims();
        let list = |x: &Tensor<3>| numbers(x, dims);
        let report = &image.report;
        let none = batch.observed.range_m.zeros_like();
        let most = image.ceiling.as_ref().map_or_else(|| none.clone() + 1.0, |c| none.clone() + c.maximum.clone());
        let [mean, median, sigma, least] = reflectance(image, &most);
        let scatter = image.ceiling.as_ref().map_or_else(|| none.clone(), |c| none.clone() + c.scatter.clone());
        let scatter_error = scatter.clone() * (2.0 / std::f64::consts::PI).sqrt();
        let least = (least.square() + scatter_error.square()).sqrt();
        let least = match (&image.other, image.beside()) {
            (Some(other), Some(beside)) => {
                let step = other.surface.reflectance.clone() - image.surface.reflectance.clone();
                let there = (report.reflectance.clone() + step).clamp(0.0, 1.0) - median.clone();
                least.clone() + (distance_from(&there, &sigma) - least) * beside
            }
            _ => least,
        };
        let reflectance_sigma = (sigma.square() + scatter.square()).sqrt();
        // A reported range that is rounded to a step is off by the rounding too.
        let sigma_m = match &image.quantum {
            None => report.range_sigma_m.clone(),
            Some(quantum) => (report.range_sigma_m.clone().square() + quantum.step_m.clone().square() / 12.0).sqrt(),
        };
        let mut sigma_m = list(&sigma_m);
        let nothing_extra = image.no_extra().unwrap_or_else(|| none.clone() + 1.0);
        let returned = image.hit() * report.keep.clone();
        let only_surfaces = match image.mixed.iter().map(|mixed| mixed.probability.clone()).reduce(|a, b| a + b) {
            None => nothing_extra,
            Some(mixed) => nothing_extra * (returned * mixed * -1.0 + 1.0),
        };
        let range_m = list(&(report.range_m.clone() + none.clone()));
        let certain = certain(image, &range_m, &sigma_m, dims);
        if let Some(doubt_m) = &image.doubt_m {
            let doubted = sigma_m.iter_mut().zip(list(doubt_m)).zip(&certain).filter(|(_, certain)| !**certain);
            doubted.for_each(|((sigma_m, doubt_m), _)| *sigma_m = sigma_m.hypot(DOUBT_SIGMA * doubt_m));
        }
        let extent_m = image.rays.limits_m.1 - image.rays.limits_m.0;
        let gate = list(&report.range_outliers).iter().zip(&sigma_m).map(|(o, s)| gate(*o, *s, extent_m)).collect();
        Self {
            scene: batch.scene,
            frames: batch.frames.clone(),
            size: [dims[1], dims[2]],
            hit: list(&image.hit()),
            reflectance: list(&mean),
            median_reflectance: list(&median),
            reflectance_sigma: list(&reflectance_sigma),
            least_reflectance_error: list(&least),
            reported: list(&image.reported()),
            extra: list(&(only_surfaces * -1.0 + 1.0)),
            gate,
            certain,
            measured_range_m: list(&batch.observed.range_m),
            measured_reflectance: list(&batch.observed.reflectance),
            range_m,
            sigma_m,
        }
    }

    /// Rays of a frame.
    pub fn rays(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Whether a ray has a return.
    pub fn returned(&self, i: usize) -> bool {
        self.measured_range_m[i] > 0.0
    }

    /// Whether a ray has a return, and a surface that it could be a return of.
    pub fn is_return_of_a_surface(&self, i: usize) -> bool {
        self.returned(i) && self.hit[i] > 0.5
    }

    /// Range residual over its standard deviation.
    pub fn standardised_range(&self, i: usize) -> f64 {
        f64::from(self.measured_range_m[i] - self.range_m[i]) / f64::from(self.sigma_m[i].max(1e-6))
    }

    /// Whether a return is likelier to be an outlier than one of the surface's.
    pub fn is_outlier(&self, i: usize) -> bool {
        self.standardised_range(i).abs() > f64::from(self.gate[i])
    }
}

/// A tensor's numbers, broadcast to `size`.
pub fn numbers(x: &Tensor<3>, size: [usize; 3]) -> Vec<f32> {
    let x = if x.dims() == size { x.clone() } else { x.clone().expand(size) };
    x.into_data().iter::<f32>().collect()
}

/// Where (1 − o)·N(u)/σ falls below o/extent.
fn gate(outliers: f32, sigma_m: f32, extent_m: f64) -> f32 {
    let (o, sigma) = (f64::from(outliers).clamp(1e-9, 0.999), f64::from(sigma_m).max(1e-6));
    let ratio = (1.0 - o) * extent_m / (o * sigma * (2.0 * std::f64::consts::PI).sqrt());
    (2.0 * ratio.max(1.0).ln()).sqrt().max(2.0) as f32
}

/// Whether the surface of each ray, if it was moved, is known, and the second one is none or the same.
fn certain(image: &Image, range_m: &[f32], sigma_m: &[f32], size: [usize; 3]) -> Vec<bool> {
    let Some(other) = &image.other else { return vec![true; range_m.len()] };
    let (hit, here_m) = (numbers(&image.surface.hit, size), numbers(&image.surface.range_m, size));
    let known = numbers(&image.surface.known, size);
    let (weight, there, there_m) =
        (numbers(&other.weight, size), numbers(&other.surface.hit, size), numbers(&other.surface.range_m, size));
    (0..range_m.len())
        .map(|i| {
            let same = (hit[i] - there[i]).abs() < 0.5
                && (hit[i] < 0.5 || (here_m[i] - there_m[i]).abs() < LEAST_STEP_M + 3.0 * sigma_m[i]);
            (same || weight[i] < LEAST_WEIGHT) && (hit[i] < 0.5 || known[i] > 0.5)
        })
        .collect()
}

/// Mean, median, standard deviation and mean distance from the median of reported reflectances, held between 0 and `most`.
fn reflectance(image: &Image, most: &Tensor<3>) -> [Tensor<3>; 4] {
    let report = &image.report;
    let (seen, sigma) = (&report.reflectance, &report.reflectance_sigma);
    let of = |mean: &Tensor<3>, sigma: &Tensor<3>| censored(mean, sigma, &report.reflectance_outliers, most);
    let (mean, least) = of(seen, sigma);
    let Some(other) = &image.other_angle else {
        return [mean, held(seen, most), sigma.clone(), least];
    };
    let share = other.share.clone();
    let [there, wide] = other.reflectance(seen, sigma);
    let (mean_there, least_there) = of(&there, &wide);
    let mostly = (share.clone() + least.zeros_like()).greater_elem(0.5);
    let off = there.clone() - seen.clone();
    let from_seen = least.mask_where(mostly.clone(), distance_from(&off, sigma));
    let from_there = distance_from(&off, &wide).mask_where(mostly.clone(), least_there);
    let between = off.square() * share.clone() * (share.clone() * -1.0 + 1.0);
    let variance = sigma.clone().square() + (wide.square() - sigma.clone().square()) * share.clone() + between;
    [
        mean.clone() + (mean_there - mean) * share.clone(),
        held(&(seen.clone() + mostly.float() * (there - seen.clone())), most),
        variance.sqrt(),
        from_seen.clone() + (from_there - from_seen) * share,
    ]
}

fn held(x: &Tensor<3>, most: &Tensor<3>) -> Tensor<3> {
    x.clone().clamp_min(0.0).min_pair(most.clone())
}

/// Mean distance of a normal number from a place that is this far from its mean.
fn distance_from(far: &Tensor<3>, sigma: &Tensor<3>) -> Tensor<3> {
    let u = far.clone() / sigma.clone();
    let density = (u.clone().square() * -0.5).exp() * (2.0 / std::f64::consts::PI).sqrt();
    sigma.clone() * density + far.clone() * (cumulative(&u) * 2.0 - 1.0)
}

/// Mean of a normal number that is held between 0 and `most` and is with a small probability uniform from 0 to 1 instead, and its mean
/// distance from its median.
///
/// With G(u) = u·Φ(u) + φ(u), whose derivative is Φ: ∫ₐᵇ Φ((t − μ)/σ) dt = σ·[G((b − μ)/σ) − G((a − μ)/σ)].
fn censored(mean: &Tensor<3>, sigma: &Tensor<3>, outliers: &Tensor<3>, most: &Tensor<3>) -> (Tensor<3>, Tensor<3>) {
    let g = |u: Tensor<3>| {
        let density = (u.clone().square() * -0.5).exp() * (1.0 / (2.0 * std::f64::consts::PI).sqrt());
        u.clone() * cumulative(&u) + density
    };
    let at = |x: Tensor<3>| g(x / sigma.clone()) * sigma.clone();
    let median = held(mean, most);
    let below_0 = at(mean.clone() * -1.0);
    let above = at(mean.clone() - most.clone());
    let inside_mean = mean.clone() + below_0.clone() - above.clone();
    let distance = at(median.clone() - mean.clone()) - below_0 + at(mean.clone() - median.clone()) - above;
    let uniform = (median.clone().square() + (median * -1.0 + 1.0).square()) * 0.5;
    let inside = outliers.clone() * -1.0 + 1.0;
    (inside_mean * inside.clone() + outliers.clone() * 0.5, distance * inside + uniform * outliers.clone())
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;

    #[test]
    fn a_reflectance_held_to_its_limits_has_the_moments_of_many_draws() {
        let one = |x: f32| Tensor::<1>::from_floats([x], &Device::flex()).reshape([1, 1, 1]);
        for (mean, sigma, outliers, most) in [
            (0.5, 0.05, 0.0, 1.0),
            (0.02, 0.1, 0.0, 1.0),
            (-0.1, 0.2, 0.02, 1.0),
            (0.97, 0.08, 0.01, 1.0),
            (0.6, 0.1, 0.0, 0.65),
        ] {
            let (held, least) = censored(&one(mean), &one(sigma), &one(outliers), &one(most));
            let (held, least) = (numbers(&held, [1; 3])[0], numbers(&least, [1; 3])[0]);
            // A midpoint rule over the quantiles is as good as 20 000 draws.
            let n = 20_000;
            let u = (Tensor::arange(0..n, &Device::flex()).float() + 0.5) / n as f32;
            let drawn = crate::effects::draw::normal(u.clone().reshape([1, 1, -1])) * sigma + mean;
            let drawn = numbers(&drawn.clamp(0.0, most), [1, 1, n as usize]);
            let uniform = numbers(&u.reshape([1, 1, -1]), [1, 1, n as usize]);
            let median = mean.clamp(0.0, most);
            let over = |of: &dyn Fn(f32) -> f32| {
                let mean = |x: &[f32]| x.iter().map(|x| of(*x)).sum::<f32>() / n as f32;
                mean(&drawn) * (1.0 - outliers) + mean(&uniform) * outliers
            };
            assert!((held - over(&|x| x)).abs() < 1e-3, "mean of {mean} ± {sigma}: {held}");
            assert!((least - over(&|x| (x - median).abs())).abs() < 1e-3, "distance for {mean} ± {sigma}: {least}");
        }
    }

    #[test]
    fn the_gate_is_where_an_outlier_is_as_likely() {
        let u = f64::from(gate(0.01, 0.02, 100.0));
        let normal = 0.99 * (-0.5 * u * u).exp() / (0.02 * (2.0 * std::f64::consts::PI).sqrt());
        assert!((normal / (0.01 / 100.0) - 1.0).abs() < 1e-3, "{u}");
    }
}
