//! How likely a measured scan is under a sensor model: one likelihood a channel, none mixed with another.
//!
//! A ray is reported with probability P = 1 − (1 − h·k)·∏(1 − eⱼ): h is whether it hits a surface, k whether the surface is reported, eⱼ
//! the extra returns. A reported range has the density of a mixture: normal around the surface, with wide tails where a moved ray's surface
//! is not all known, a second surface where a moved ray passes an edge, a uniform part between two surfaces (mixed pixels), the extra
//! returns, and a uniform outlier part over the sensor's range. Where ranges come in steps, the mixture says in which step, and a comb of
//! teeth where in the step. A reported reflectance is normal around the surface's, or around what the surface
//! would report at another angle than the image shows, held to a maximum if the sensor has one, censored at 0 and 1, with an outlier part. Rays without a return are data.
//!
//! Each is a probability distribution whatever the parameters: densities integrate to 1, and no logarithm meets a 0.

use burn::tensor::Tensor;

use super::voigt::{Voigt, cauchy, normal};
use crate::effects::Image;
use crate::effects::draw::cumulative;
use crate::effects::image::{Ceiling, Quantum};

/// Probability of a return where nothing explains one, and of none where nothing takes it: keeps logarithms finite, and any explanation
/// better than none.
const STRAY: f64 = 1e-5;

/// Share of the reports that keep to no comb, and may lie anywhere in their step.
const BETWEEN_TEETH: f64 = 1e-3;

/// Share of the reflectance outliers that are 0, and of those that are 1; the others are anything between.
const OUTLIERS_AT_END: f64 = 0.1;

/// Nodes and weights of Gauss's and Legendre's quadrature from 0 to 4 standard deviations.
const SCATTER_NODES: [(f64, f64); 4] =
    [(0.277_727_4, 0.695_709_7), (1.320_037_9, 1.304_290_3), (2.679_962_1, 1.304_290_3), (3.722_272_6, 0.695_709_7)];

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
    let bell = |mean: &Tensor<3>, sigma: &Tensor<3>| match &image.quantum {
        None => normal(&((z.clone() - mean.clone()) / sigma.clone())) / sigma.clone(),
        Some(quantum) => quantum.mean_density(z, mean, sigma),
    };
    let tails = |mean: &Tensor<3>, half_width: &Tensor<3>| match &image.quantum {
        None => cauchy(&(z.clone() - mean.clone()), half_width),
        Some(quantum) => quantum.mean_cauchy(z, mean, half_width),
    };
    let doubted = image.doubt_m.as_ref().map(|doubt_m| Voigt::new(&sigma, doubt_m));
    let density = |mean: Tensor<3>| match &doubted {
        None => bell(&mean, &sigma),
        Some(voigt) => {
            let bell = bell(&mean, &voigt.sigma);
            bell.clone() + (tails(&mean, &voigt.half_width) - bell) * voigt.share.clone()
        }
    };
    let mut surface = density(report.range_m.clone());
    if let Some(other) = &image.other {
        let beside = other.surface.range_m.clone() + image.range_error_m();
        let here = surface * image.surface.hit.clone() * (other.weight.clone() * -1.0 + 1.0);
        surface =
            (here + density(beside) * other.surface.hit.clone() * other.weight.clone()) / image.hit().clamp_min(1e-9);
    }
    let mixed: Option<[Tensor<3>; 2]> = (image.mixed.iter())
        .map(|mixed| {
            let within = z.clone() - image.range_error_m();
            let step = |at: &Tensor<3>| cumulative(&((within.clone() - at.clone()) / sigma.clone()));
            let width = (mixed.far_m.clone() - mixed.near_m.clone()).clamp_min(1e-2);
            let between = (step(&mixed.near_m) - step(&mixed.far_m)).clamp_min(0.0) / width;
            [between * mixed.probability.clone(), mixed.probability.clone()]
        })
        .reduce(|[a, p], [b, q]| [a + b, p + q]);
    if let Some([between, probability]) = mixed {
        surface = surface * (probability * -1.0 + 1.0) + between;
    }
    let outliers = report.range_outliers.clone();
    let surface = surface * (outliers.clone() * -1.0 + 1.0) + outliers / extent;

    let reported = image.hit() * report.keep.clone();
    let mut joint = surface * reported.clone();
    let mut any = reported;
    for extra in &image.extra {
        let (here, not) = (&extra.probability, extra.probability.clone() * -1.0 + 1.0);
        joint = joint * not.clone() + extra.place.density(z) * here.clone();
        any = any * not + here.clone();
    }
    let density = (joint + STRAY / extent) / (any + STRAY);
    let nats = density.clamp_min(1e-30).log();
    let nats = match &image.quantum {
        None => nats,
        Some(quantum) => nats + quantum.comb(z).log(),
    };
    nats * observed.returned.clone()
}

/// Log-likelihood of the reflectances of the returns, nats a ray, `[batch, ring, column]`.
pub fn reflectance(image: &Image, observed: &Observed, soften: f64) -> Tensor<3> {
    let report = &image.report;
    let i = &observed.reflectance;
    let sigma = (report.reflectance_sigma.clone().square() + soften * soften).sqrt();
    let (floor, end) = (i.clone().lower_equal_elem(0.0), i.clone().greater_equal_elem(1.0));
    let bell = |mean: &Tensor<3>, sigma: &Tensor<3>| {
        // The distribution's parts: inside, and what censoring heaps up at either end.
        let [below, inside, above] = match &image.ceiling {
            None => {
                let z = (i.clone() - mean.clone()) / sigma.clone();
                let (below, above) = (mean.clone() * -1.0 / sigma.clone(), (mean.clone() - 1.0) / sigma.clone());
                [cumulative(&below), normal(&z) / sigma.clone(), cumulative(&above)]
            }
            Some(ceiling) => ceiling.parts(i, mean, sigma, soften),
        };
        inside.mask_where(floor.clone(), below).mask_where(end.clone(), above)
    };
    let density = |mean: &Tensor<3>| {
        let seen = bell(mean, &sigma);
        match &image.other_angle {
            None => seen,
            Some(other) => {
                let [mean, sigma] = other.reflectance(mean, &sigma);
                seen.clone() + (bell(&mean, &sigma) - seen) * other.share.clone()
            }
        }
    };
    let mut likelihood = density(&report.reflectance);
    if let (Some(other), Some(beside)) = (&image.other, image.beside()) {
        let step = other.surface.reflectance.clone() - image.surface.reflectance.clone();
        let there = density(&(report.reflectance.clone() + step));
        likelihood = likelihood.clone() + (there - likelihood) * beside;
    }
    let at_end = floor.clone().bool_or(end.clone()).float();
    let outlier = at_end * (3.0 * OUTLIERS_AT_END - 1.0) + (1.0 - 2.0 * OUTLIERS_AT_END);
    let outliers = report.reflectance_outliers.clone();
    let likelihood = likelihood * (outliers.clone() * -1.0 + 1.0) + outliers * outlier;
    // The reflectance of a return that no surface explains says nothing about surfaces.
    let explained = image.hit().greater_elem(1e-3).float();
    likelihood.clamp_min(1e-30).log() * observed.returned.clone() * explained
}

/// Log-likelihood of which rays have a return, nats a ray, `[batch, ring, column]`.
pub fn returns(image: &Image, observed: &Observed) -> Tensor<3> {
    let p = image.reported().clamp(0.0, 1.0) * (1.0 - 2.0 * STRAY) + STRAY;
    let yes = p.clone().log() * observed.returned.clone();
    let no = (p * -1.0 + 1.0).log() * (observed.returned.clone() * -1.0 + 1.0);
    yes + no
}

impl Quantum {
    /// How far beyond the nearest multiple of the step a range lies, in m.
    fn beyond_m(&self, z: &Tensor<3>) -> Tensor<3> {
        z.clone() - (z.clone() / self.step_m.clone()).detach().round() * self.step_m.clone()
    }

    /// Density of a normal number, averaged over the step that `z` lies in.
    fn mean_density(&self, z: &Tensor<3>, mean: &Tensor<3>, sigma: &Tensor<3>) -> Tensor<3> {
        // Away from the mean, the distribution function is small on one side only: look from there, where differences keep their digits.
        let middle = (z.clone() - self.beyond_m(z) - mean.clone()).abs() * -1.0;
        let half = self.step_m.clone() * 0.5;
        let (from, to) = ((middle.clone() - half.clone()) / sigma.clone(), (middle + half) / sigma.clone());
        (cumulative(&to) - cumulative(&from)).clamp_min(0.0) / self.step_m.clone()
    }

    /// The same of a Cauchy distributed number.
    fn mean_cauchy(&self, z: &Tensor<3>, mean: &Tensor<3>, half_width: &Tensor<3>) -> Tensor<3> {
        let middle = z.clone() - self.beyond_m(z) - mean.clone();
        let half = self.step_m.clone() * 0.5;
        // The angle that the step fills, seen from half a width aside.
        let away = middle.square() - half.square() + half_width.clone().square();
        let angle = (self.step_m.clone() * half_width.clone()).atan2(away);
        angle / self.step_m.clone() * std::f64::consts::FRAC_1_PI
    }

    /// Where in its step a report lies, relative to anywhere: a normal tooth cut off at the step's ends.
    fn comb(&self, z: &Tensor<3>) -> Tensor<3> {
        let tooth = normal(&(self.beyond_m(z) / self.tooth_m.clone())) * self.step_m.clone() / self.tooth_m.clone();
        let ends = self.step_m.clone() / self.tooth_m.clone() * (0.5 * std::f64::consts::FRAC_1_SQRT_2);
        tooth / ends.erf().clamp_min(1e-6) * (1.0 - BETWEEN_TEETH) + BETWEEN_TEETH
    }
}

impl Ceiling {
    /// Of min(N(mean, σ²), maximum) + N(0, scatter²): the probability of 0 or less, the density at `i`, the probability of 1 or more.
    fn parts(&self, i: &Tensor<3>, mean: &Tensor<3>, sigma: &Tensor<3>, soften: f64) -> [Tensor<3>; 3] {
        let maximum = &self.maximum;
        let scatter = (self.scatter.clone().square() + soften * soften).sqrt();
        let (own, added) = (sigma.clone().square(), scatter.clone().square());
        let whole = own.clone() + added.clone();
        let root = whole.clone().sqrt();
        let standard = |x: Tensor<3>| x / sigma.clone();
        let held = cumulative(&standard(mean.clone() - maximum.clone()));

        // Below the maximum, a cut normal convolved with the scatter; at it, the scatter alone.
        let likeliest = (mean.clone() * added + i.clone() * own) / whole;
        let spread = sigma.clone() * scatter.clone() / root.clone();
        let below = cumulative(&((maximum.clone() - likeliest) / spread));
        let free = normal(&((i.clone() - mean.clone()) / root.clone())) / root.clone() * below;
        let at_maximum = normal(&((i.clone() - maximum.clone()) / scatter.clone())) / scatter.clone();

        // What lies below the maximum is scattered to 1 or beyond if the scatter is more than the rest of the way: an integral over it.
        let to_one = (maximum.clone() * -1.0 + 1.0) / scatter.clone();
        let ended =
            SCATTER_NODES.into_iter().fold(held.clone() * cumulative(&(to_one.clone() * -1.0)), |sum, (n, w)| {
                let n = to_one.clone() + n;
                let beyond = cumulative(&standard(mean.clone() - 1.0 + n.clone() * scatter.clone())) - held.clone();
                sum + normal(&n) * beyond.clamp_min(0.0) * w
            });
        [cumulative(&(mean.clone() * -1.0 / root)), free + held * at_maximum, ended]
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, TensorData};
    use lidar::Sensor;

    use super::*;
    use crate::effects::image::{Mixed, Other, OtherAngle};
    use crate::effects::{Extra, Place, Rays, Simulated, Surface};

    const RINGS: usize = 4;
    const COLUMNS: usize = 8;

    fn tensor(values: Vec<f32>, shape: [usize; 3]) -> Tensor<3> {
        Tensor::from_data(TensorData::new(values, shape), &Device::flex())
    }

    fn one(x: f64) -> Tensor<3> {
        tensor(vec![x as f32], [1, 1, 1])
    }

    /// A ring wall around the sensor, a pillar before it, reflectances from black to beyond white, a ray without a surface.
    fn image() -> Image {
        let sensor = Sensor::from_elevations_deg("test", vec![6.0, 2.0, -2.0, -6.0], COLUMNS, (1.0, 80.0), 10.0)
            .expect("a sensor");
        let pixel = |of: &dyn Fn(usize, usize) -> f32| {
            tensor((0..RINGS * COLUMNS).map(|i| of(i / COLUMNS, i % COLUMNS)).collect(), [1, RINGS, COLUMNS])
        };
        let simulated = Simulated {
            range_m: pixel(&|k, c| {
                if (k, c) == (0, 0) {
                    0.0
                } else if c == 3 {
                    12.0
                } else {
                    30.0
                }
            }),
            reflectance: pixel(&|k, c| (k * COLUMNS + c) as f32 / 28.0),
            class: pixel(&|_, _| 1.0),
            keep: pixel(&|_, _| 0.9),
            frame: one(0.0),
        };
        let mut image = Image::new(simulated, Rays::new(&sensor, &Device::flex()));
        image.report.range_sigma_m = one(0.1);
        image.report.reflectance_sigma = one(0.06);
        image.report.range_outliers = one(0.02);
        image.report.reflectance_outliers = one(0.05);
        image
    }

    fn mixed(mut image: Image) -> Image {
        let range_m = image.surface.range_m.clone();
        image.mixed =
            vec![Mixed { probability: one(0.3), near_m: range_m.clone() * 0.6 + 2.0, far_m: range_m.clone() + 5.0 }];
        image.report.range_m = image.report.range_m + 0.3;
        let there = Surface {
            range_m: range_m.clone() * 0.0 + 9.0,
            hit: one(1.0),
            reflectance: one(0.8),
            ..image.surface.clone()
        };
        image.other = Some(Other { surface: there, weight: one(0.4) });
        image.extra = vec![
            Extra {
                probability: one(0.1),
                place: Place::Uniform { from_m: one(1.0), to_m: one(80.0) },
                reflectance: one(0.1),
            },
            Extra {
                probability: one(0.2),
                place: Place::Exponential { from_m: one(1.0), scale_m: one(3.0), to_m: one(80.0) },
                reflectance: one(0.1),
            },
        ];
        image
    }

    fn in_steps(mut image: Image, step_m: f64, tooth_m: f64) -> Image {
        image.quantum = Some(Quantum { step_m: one(step_m), tooth_m: one(tooth_m) });
        image
    }

    fn doubted(mut image: Image) -> Image {
        image.doubt_m = Some(one(0.03));
        image
    }

    /// Integrals of the range density, a ray each.
    fn range_integrals(image: &Image) -> Vec<f64> {
        let (from, to) = image.rays.limits_m;
        let step = 0.0025;
        let n = ((to - from) / step) as usize;
        let grid: Vec<f32> = (0..n).map(|j| (from + (j as f64 + 0.5) * step) as f32).collect();
        let observed = Observed::new(tensor(grid, [n, 1, 1]), one(0.5));
        let density = range(image, &observed, 0.0).exp() * step;
        density.sum_dim(0).into_data().iter::<f64>().collect()
    }

    #[test]
    #[expect(clippy::large_stack_arrays, reason = "a handful of images, once")]
    fn range_densities_integrate_to_one() {
        for image in [
            image(),
            mixed(image()),
            doubted(mixed(image())),
            in_steps(image(), 0.5, 0.02),
            in_steps(doubted(image()), 0.2, 0.02),
            in_steps(image(), 0.02, 0.004),
            in_steps(mixed(image()), 0.2, 0.1),
        ] {
            for integral in range_integrals(&image) {
                assert!((integral - 1.0).abs() < 5e-3, "{integral} with steps {:?}", image.quantum);
            }
        }
    }

    #[test]
    #[expect(clippy::large_stack_arrays, reason = "a handful of images, once")]
    fn reflectances_have_probability_one_with_what_heaps_up_at_the_ends() {
        let held = |maximum: f64, scatter: f64| {
            let mut image = image();
            image.ceiling = Some(Ceiling { maximum: one(maximum), scatter: one(scatter) });
            image
        };
        let astray = |mut image: Image| {
            image.other_angle = Some(OtherAngle { share: one(0.3), factor: one(0.6), spread: one(0.4) });
            image
        };
        for image in [
            image(),
            mixed(image()),
            astray(held(0.6, 0.06)),
            astray(image()),
            held(0.6, 0.003),
            held(0.6, 0.06),
            held(0.95, 0.05),
            held(1.0, 0.02),
        ] {
            let n = 10_000;
            let mut grid: Vec<f32> = (0..n).map(|j| (j as f32 + 0.5) / n as f32).collect();
            grid.extend([0.0, 1.0]);
            let observed = Observed::new(one(10.0), tensor(grid, [n + 2, 1, 1]));
            let likelihood = reflectance(&image, &observed, 0.0).exp();
            let inside = likelihood.clone().narrow(0, 0, n).sum_dim(0) / n as f64;
            let whole = inside + likelihood.narrow(0, n, 2).sum_dim(0);
            // The ray without a surface has no reflectance: its likelihood is 1 for anything.
            for whole in whole.into_data().iter::<f64>().skip(1) {
                assert!((whole - 1.0).abs() < 2e-3, "{whole} with {:?}", image.ceiling);
            }
        }
    }

    #[test]
    fn a_ray_is_reported_or_not() {
        let likelihood = |returned: f64| returns(&mixed(image()), &Observed::new(one(returned), one(0.5))).exp();
        for sum in (likelihood(1.0) + likelihood(0.0)).into_data().iter::<f64>() {
            assert!((sum - 1.0).abs() < 1e-6, "{sum}");
        }
    }
}
