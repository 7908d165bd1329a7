//! Ghosts around bright targets.

use burn::tensor::{Tensor, activation::sigmoid};

use super::neighbours::at;
use super::{About, ActsOn, Channel, Effect, Evidence, Extra, Image, Parameter, Place, Values};

/// Rays that pass at an angle d beside a target of reflectance above a threshold report its range with probability p·e^{−d/ℓ}, or of those
/// that meet something nearer, a share: none where a sensor reports the first return, more where it reports the strongest.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blooming;

/// Targets are looked for this many rings above and below.
const RINGS: i64 = 5;

/// Targets are looked for at least this far to either side, in degrees.
const ASIDE_DEG: f64 = 6.0;

/// Share of the ghosts that come although what their ray meets is nearer, where a fit starts.
const BEHIND: f64 = 0.2;

/// Softness of the threshold.
const SOFT: f64 = 0.02;

/// Spread of a ghost around its target's range beside the range noise, in m.
const SPREAD_M: f64 = 0.05;

/// Squared angle of a target that is not there.
const FAR: f64 = 1e6;

impl Effect for Blooming {
    fn about(&self) -> About {
        About {
            name: "blooming",
            does: "sees targets of reflectance above {threshold} larger than they are: beside them a ray reports their range with a probability of {probability}, which falls by e every {length_deg}°",
            channel: Channel::Extra,
            acts_on: ActsOn { range: true, reflectance: false, returns: true },
            covariates: &["bright_distance"],
            formula: "p·e^{−d/ℓ}, or a share of it behind something nearer, at the range of the nearest target with I > I₀",
            source: "Uttarkabat et al., BloomNet (2024); blooming around retroreflectors: Velodyne and Ouster user manuals",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::probability("probability", 1e-3, (1e-4, 1.0)),
            Parameter::positive("length_deg", 0.5, (0.02, 10.0)),
            Parameter::free("threshold", 0.02, (0.05, 1.0)).from(0.9),
            Parameter::probability("share_behind", BEHIND, (0.0, 1.0)),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let target = Target::nearest(&image, &values.one(2).detach());
        // The target itself is no ghost.
        let beside =
            target.angle2.clone().greater_elem(1e-9).float() * target.angle2.clone().lower_elem(FAR / 2.0).float();
        let near = (target.angle2.clamp_min(1e-9).sqrt() / values.one(1) * -1.0).exp() * beside;
        let bright = sigmoid((target.reflectance.clone() - values.one(2)) / SOFT);
        let behind = (target.range_m.clone() - image.surface.range_m.clone()).greater_elem(0.0).float();
        let seen = behind * image.surface.hit.clone() * (values.one(3) - 1.0) + 1.0;
        let sigma_m = (image.report.range_sigma_m.clone().square() + SPREAD_M * SPREAD_M).sqrt();
        image.extra.push(Extra {
            probability: near.clone() * bright * seen * values.one(0),
            place: Place::At { range_m: target.range_m, sigma_m },
            reflectance: target.reflectance * near,
        });
        image
    }

    fn starts(&self, evidence: &Evidence) -> Vec<Vec<f64>> {
        let mut beside = beside_targets(evidence);
        beside.sort_unstable_by(|a, b| b.reflectance.total_cmp(&a.reflectance));
        let all = beside.iter().filter(|b| b.ghost).count() as f64;
        let log_likelihood = |ghosts: f64, n: f64| {
            let of = |k: f64| if k > 0.0 { k * (k / n).ln() } else { 0.0 };
            of(ghosts) + of(n - ghosts)
        };
        let (mut ghosts, mut best) = (0.0, None);
        let mut most = log_likelihood(all, beside.len() as f64) + 3.0;
        for (i, here) in beside.iter().enumerate() {
            ghosts += f64::from(u8::from(here.ghost));
            let n = (i + 1) as f64;
            let ends = beside.get(i + 1).is_none_or(|next| next.reflectance < here.reflectance);
            let likelihood = log_likelihood(ghosts, n) + log_likelihood(all - ghosts, beside.len() as f64 - n);
            if ends && likelihood > most && ghosts / n > all / beside.len() as f64 {
                let below = beside.get(i + 1).map_or(here.reflectance, |next| next.reflectance);
                most = likelihood;
                best = Some((ghosts / n, f64::from(here.reflectance + below) / 2.0));
            }
        }
        let column_deg = 360.0 / evidence.columns as f64;
        best.map(|(rate, threshold)| vec![(1.6 * rate).min(0.95), 2.0 * column_deg, threshold, BEHIND])
            .into_iter()
            .collect()
    }
}

/// Angle to the nearest target of at least this reflectance in degrees, 0 on the target itself; held to how far ghosts reach.
pub(super) fn distance_deg(image: &Image, threshold: f64) -> Tensor<3> {
    let threshold = Tensor::zeros([1, 1, 1], &image.device()) + threshold;
    Target::nearest(image, &threshold).angle2.clamp_max(ASIDE_DEG * ASIDE_DEG).sqrt()
}

/// The nearest bright target of each ray.
#[derive(Clone)]
struct Target {
    /// Squared angle to it.
    angle2: Tensor<3>,
    /// Number of columns to it, to the right.
    right: Tensor<3>,
    range_m: Tensor<3>,
    reflectance: Tensor<3>,
}

impl Target {
    /// Looks along the rings first and then across: the squared angle is a sum of both, so the nearest of the nearest is the nearest.
    ///
    /// Along a ring by steps of half the length each time, as Rong and Tan, "Jump flooding in GPU with applications to Voronoi diagram and
    /// distance transform" (2006): on a line that is exact.
    fn nearest(image: &Image, threshold: &Tensor<3>) -> Self {
        let rays = &image.rays;
        let surface = &image.surface;
        let bright = (surface.reflectance.clone() - threshold.clone()).greater_elem(-3.0 * SOFT).float();
        let bright = bright * surface.hit.clone();
        let mut along = Self {
            angle2: (bright.clone().detach() * -1.0 + 1.0) * FAR,
            right: bright.zeros_like(),
            range_m: image.report.range_m.clone().detach(),
            reflectance: surface.reflectance.clone().detach(),
        };
        let column_deg = 360.0 / rays.size()[1] as f64;
        let level = rays.elevation_rad.clone().cos() * column_deg;
        let halvings = (ASIDE_DEG / column_deg).log2().floor().max(0.0) as u32;
        for n in (0..=halvings).rev().flat_map(|k| [-(1 << k), 1 << k]) {
            let there = along.at([0, n]);
            let right = there.right.clone() + n as f64;
            let angle2 = (right.clone() * level.clone()).square();
            let is_target = there.angle2.clone().lower_elem(FAR / 2.0).float();
            let angle2 = angle2 * is_target.clone() + (is_target * -1.0 + 1.0) * FAR;
            along = along.or(Self { angle2, right, ..there });
        }
        let mut nearest = along.clone();
        for n in (1..=RINGS).flat_map(|n| [-n, n]) {
            let angle = (at(&rays.elevation_rad, n, 0, 10.0) - rays.elevation_rad.clone()).rad2deg();
            let there = along.at([n, 0]);
            nearest = nearest.or(Self { angle2: there.angle2.clone() + angle.square(), ..there });
        }
        nearest
    }

    /// The targets of the pixels beside.
    fn at(&self, [down, right]: [i64; 2]) -> Self {
        Self {
            angle2: at(&self.angle2, down, right, FAR),
            right: at(&self.right, down, right, 0.0),
            range_m: at(&self.range_m, down, right, 0.0),
            reflectance: at(&self.reflectance, down, right, 0.0),
        }
    }

    /// The nearer of two, pixel by pixel.
    fn or(self, other: Self) -> Self {
        let nearer = other.angle2.clone().lower(self.angle2.clone());
        Self {
            angle2: self.angle2.mask_where(nearer.clone(), other.angle2),
            right: self.right.mask_where(nearer.clone(), other.right),
            range_m: self.range_m.mask_where(nearer.clone(), other.range_m),
            reflectance: self.reflectance.mask_where(nearer, other.reflectance),
        }
    }
}

/// A ray beside a surface at another range.
struct Beside {
    /// Reflectance of the surface.
    reflectance: f32,
    /// Whether the ray reports the surface's range.
    ghost: bool,
}

/// The rays beside surfaces at another range, each with the brightest that is at most two pixels away.
fn beside_targets(evidence: &Evidence) -> Vec<Beside> {
    let (rings, columns) = (evidence.rings, evidence.columns);
    let of = |i: usize| {
        let (first, ring, column) = (i - i % (rings * columns), i / columns % rings, i % columns);
        let rows = ring.saturating_sub(2)..(ring + 3).min(rings);
        let pixels = rows.flat_map(|k| (0..5).map(move |c| first + k * columns + (column + columns + c - 2) % columns));
        let another =
            |j: &usize| evidence.range_m[*j] > 0.0 && (evidence.range_m[*j] - evidence.range_m[i]).abs() > 1.0;
        let target = pixels
            .filter(another)
            .max_by(|a, b| evidence.surface_reflectance[*a].total_cmp(&evidence.surface_reflectance[*b]))?;
        let reflectance = evidence.surface_reflectance[target];
        let ghost = (evidence.measured_range_m[i] - evidence.range_m[target]).abs() < 0.3;
        (reflectance > 0.2).then_some(Beside { reflectance, ghost })
    };
    evidence.pixels().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_how_far_ghosts_reach() {
        Trial::of(Arc::new(Blooming), &[0.8, 1.5, 0.6, 0.3]).each_within(&[0.2, 0.5, 0.1, 0.3]);
    }
}
