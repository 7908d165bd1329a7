//! How likely a measured scan is under a sensor model: one likelihood a channel, none mixed with another.
//!
//! A ray is reported with probability P = 1 − (1 − h·k)·∏(1 − eⱼ): h is whether it hits a surface, k whether the surface is reported, eⱼ
//! the extra returns. A reported range has the density of a mixture: normal around the surface, a second surface where a moved ray passes
//! an edge, a uniform part between two surfaces (mixed pixels), the extra returns, and a uniform outlier part over the sensor's range. A
//! reported reflectance is normal around the surface's, censored at 0 and 1, with a uniform outlier part. Rays without a return are data.

use burn::tensor::Tensor;

use crate::effects::Image;
use crate::effects::draw::cumulative;
use crate::effects::image::Quantum;

/// Probability of a return where nothing explains one: keeps the logarithm finite, and any explanation better than none.
const STRAY: f64 = 1e-5;

/// What a sensor measured, `[batch, ring, column]`.
#[derive(Clone, Debug)]
pub struct Observed {
    /// Range in m, 0 where there is no return.
    pub range_m: Tensor<3>,
    /// Reflectance, 0–1.
    pub reflectance: Tensor<3>,
    /// 1 where there is a return, else 0.
    pub returned: Tensor<3>,
}

impl Observed {
    /// From ranges and reflectances.
    pub fn new(range_m: Tensor<3>, reflectance: Tensor<3>) -> Self {
        let returned = range_m.clone().greater_elem(0.0).float();
        Self { range_m, reflectance, returned }
    }
}

/// Log-likelihood of the ranges of the returns, nats a ray, `[batch, ring, column]`; `soften_m` widens the normals, so that a fit that
/// starts far off finds its way.
pub fn range(image: &Image, observed: &Observed, soften_m: f64) -> Tensor<3> {
    let report = &image.report;
    let z = &observed.range_m;
    let extent = image.rays.limits_m.1 - image.rays.limits_m.0;
    let sigma = (report.range_sigma_m.clone().square() + soften_m * soften_m).sqrt();
    let density = |mean: Tensor<3>| match &image.quantum {
        None => normal(&((z.clone() - mean) / sigma.clone())) / sigma.clone(),
        Some(quantum) => comb(z, &mean, &sigma, quantum),
    };
    let mut surface = density(report.range_m.clone());
    if let Some(other) = &image.other {
        let beside = other.range_m.clone() + (report.range_m.clone() - image.surface.range_m.clone());
        let here = surface * image.surface.hit.clone() * (other.weight.clone() * -1.0 + 1.0);
        surface = (here + density(beside) * other.hit.clone() * other.weight.clone()) / image.hit().clamp_min(1e-9);
    }
    if let Some(mixed) = &image.mixed {
        let step = |at: &Tensor<3>| cumulative(&((z.clone() - at.clone()) / sigma.clone()));
        let width = (mixed.far_m.clone() - mixed.near_m.clone()).clamp_min(1e-2);
        let between = (step(&mixed.near_m) - step(&mixed.far_m)).clamp_min(0.0) / width;
        surface = surface * (mixed.probability.clone() * -1.0 + 1.0) + between * mixed.probability.clone();
    }
    let outliers = report.range_outliers.clone();
    let surface = surface * (outliers.clone() * -1.0 + 1.0) + outliers / extent;

    let reported = image.hit() * report.keep.clone();
    let mut joint = surface * reported.clone();
    let mut any = reported;
    if let Some(none) = image.no_extra() {
        joint = joint * none.clone();
        any = (any * -1.0 + 1.0) * none * -1.0 + 1.0;
        for extra in &image.extra {
            joint = joint + extra.place.density(z) * extra.probability.clone();
        }
    }
    let density = (joint + STRAY / extent) / (any + STRAY);
    density.clamp_min(1e-30).log() * observed.returned.clone()
}

/// Log-likelihood of the reflectances of the returns, nats a ray, `[batch, ring, column]`.
pub fn reflectance(image: &Image, observed: &Observed, soften: f64) -> Tensor<3> {
    let report = &image.report;
    let i = &observed.reflectance;
    let sigma = (report.reflectance_sigma.clone().square() + soften * soften).sqrt();
    let mean = report.reflectance.clone();
    let inside = normal(&((i.clone() - mean.clone()) / sigma.clone())) / sigma.clone();
    let at_floor = cumulative(&((i.clone() - mean.clone()) / sigma.clone()));
    let at_ceiling = cumulative(&((mean - i.clone()) / sigma));
    let likelihood = inside
        .mask_where(i.clone().lower_equal_elem(0.0), at_floor)
        .mask_where(i.clone().greater_equal_elem(1.0), at_ceiling);
    let outliers = report.reflectance_outliers.clone();
    let likelihood = likelihood * (outliers.clone() * -1.0 + 1.0) + outliers;
    // The reflectance of a return that no surface explains says nothing about surfaces.
    likelihood.clamp_min(1e-30).log() * observed.returned.clone() * image.surface.hit.clone()
}

/// Log-likelihood of which rays have a return, nats a ray, `[batch, ring, column]`.
pub fn returns(image: &Image, observed: &Observed) -> Tensor<3> {
    let p = image.reported();
    let yes = (p.clone() + STRAY).clamp_max(1.0).log() * observed.returned.clone();
    let no = (p * -1.0 + 1.0).clamp_min(STRAY).log() * (observed.returned.clone() * -1.0 + 1.0);
    yes + no
}

/// Standard normal density.
fn normal(z: &Tensor<3>) -> Tensor<3> {
    (z.clone().square() * -0.5).exp() * (1.0 / (2.0 * std::f64::consts::PI).sqrt())
}

/// Density of a normal number that is rounded to multiples of a step and then blurred a little.
fn comb(z: &Tensor<3>, mean: &Tensor<3>, sigma: &Tensor<3>, quantum: &Quantum) -> Tensor<3> {
    let number = (z.clone() / quantum.step_m.clone()).detach().round();
    let tooth = number.clone() * quantum.step_m.clone();
    let edge = |half: f64| {
        let at = (number.clone() + half) * quantum.step_m.clone();
        cumulative(&((at - mean.clone()) / sigma.clone()))
    };
    let mass = (edge(0.5) - edge(-0.5)).clamp_min(0.0);
    mass * normal(&((z.clone() - tooth) / quantum.tooth_m.clone())) / quantum.tooth_m.clone()
}
