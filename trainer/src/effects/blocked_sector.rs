//! Dirt on the window or a part of the mount in front of it.

use burn::tensor::{Tensor, activation::sigmoid};

use super::{About, ActsOn, Channel, Effect, Evidence, Image, Parameter, Rays, Values};

/// keep · (1 − d) within a sector of azimuths (counted to the left of ahead) and a range of rings (counted from the top).
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockedSector;

/// Softness of the sector's edges, in columns or rings: over about one of them the logistic function goes from 0 to 1.
const SOFT: f64 = 0.25;

/// The search for a start looks at no more columns than this, adjacent ones taken together.
const COLUMNS: usize = 256;

impl Effect for BlockedSector {
    fn about(&self) -> About {
        About {
            name: "blocked_sector",
            does: "is blocked from azimuth {from_deg}° to {to_deg}°, rings {first_ring} to {last_ring}, where it loses a share of {drop} of its returns",
            channel: Channel::Missing,
            acts_on: ActsOn::RETURNS,
            covariates: &["azimuth", "ring"],
            formula: "keep · (1 − d) for θ₁ < θ < θ₂, k₁ ≤ k ≤ k₂",
            source: "Trierweiler et al., Influence of Sensor Blockage on Automotive LiDAR Systems (2019)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::free("from_deg", 0.5, (-540.0, 540.0)).from(-5.0),
            Parameter::free("to_deg", 0.5, (-540.0, 540.0)).from(5.0),
            Parameter::probability("drop", 0.01, (0.02, 1.0)),
            Parameter::free("first_ring", 0.5, (-100.0, 1000.0)).from(-2.0),
            Parameter::free("last_ring", 0.5, (-100.0, 1000.0)).from(1000.0),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let rays = &image.rays;
        let [_, columns] = rays.size();
        let step = |x: Tensor<3>| sigmoid(x / SOFT);
        let (from, to) = (values.one(0), values.one(1));
        let (middle, half) = ((from.clone() + to.clone()) * 0.5, (to - from) * 0.5);
        let aside = (rays.azimuth_rad.clone().rad2deg() - middle + 180.0).remainder_scalar(360.0) - 180.0;
        let sector = step((half - aside.abs()) * (columns as f64 / 360.0));
        // A ring is blocked as a whole: the edges lie half-way to the next.
        let above = step(rays.ring.clone() - values.one(3) + 0.5);
        let below = step(values.one(4) - rays.ring.clone() + 0.5);
        let left = sector * (above * below * values.one(2)) * -1.0 + 1.0;
        image.report.keep = image.report.keep * left;
        image
    }

    /// An edge may lie anywhere between two columns, or two rings.
    fn left_open(&self, _values: &[f64], rays: &Rays) -> Vec<f64> {
        let uniform = 1.0 / 12f64.sqrt();
        let column_deg = 360.0 / rays.size()[1] as f64;
        vec![uniform * column_deg, uniform * column_deg, 0.0, uniform, uniform]
    }

    fn starts(&self, evidence: &Evidence) -> Vec<Vec<f64>> {
        let (rings, columns) = (evidence.rings, evidence.columns);
        let together = columns.div_ceil(COLUMNS).max(1);
        let number = columns.div_ceil(together);
        let count = |keys: usize, key: &dyn Fn(usize) -> Option<usize>| {
            let mut out = vec![Count::default(); keys];
            for i in evidence.pixels() {
                if let Some(key) = key(i) {
                    out[key].expected += f64::from(evidence.reported[i]);
                    out[key].seen += f64::from(u8::from(evidence.returned(i)));
                }
            }
            out
        };
        let (column, ring) = (|i: usize| i % columns / together, |i: usize| i / columns % rings);
        let mut blocked_rings = 0..rings;
        let mut sector = 0..0;
        // The rings are found within the sector and the sector within the rings: a small spot takes two looks.
        for _ in 0..2 {
            let in_rings = |i| blocked_rings.contains(&ring(i)).then(|| column(i));
            let columns = count(number, &in_rings);
            let whole = columns.iter().fold(Count::default(), |a, b| a.and(*b));
            let Some(found) = worst_run(&columns, whole.rate(), true) else { return vec![] };
            sector = found;
            let inside = |i| (sector.contains(&column(i)) || sector.contains(&(column(i) + number))).then(|| ring(i));
            blocked_rings = worst_run(&count(rings, &inside), whole.rate(), false).unwrap_or(0..rings);
        }
        let (mut expected, mut seen) = (0.0, 0.0);
        for i in evidence.pixels() {
            let inside = sector.contains(&column(i)) || sector.contains(&(column(i) + number));
            if inside && blocked_rings.contains(&ring(i)) {
                expected += f64::from(evidence.reported[i]);
                seen += f64::from(u8::from(evidence.returned(i)));
            }
        }
        let drop = (1.0 - seen / f64::max(expected, 1e-9)).clamp(0.05, 0.95);
        // Columns run to the right: a sector ends, to the left, where its first column begins.
        let azimuth_deg = |column: usize| 180.0 - (column * together) as f64 * 360.0 / columns as f64;
        let (from_deg, to_deg) = (azimuth_deg(sector.end), azimuth_deg(sector.start));
        let turn = if from_deg < -180.0 { 360.0 } else { 0.0 };
        // A sector that reaches the first or last ring ends well beyond it, where its edge does nothing.
        let first = if blocked_rings.start == 0 { -3.0 } else { blocked_rings.start as f64 };
        let last = if blocked_rings.end == rings { rings as f64 + 2.0 } else { blocked_rings.end as f64 - 1.0 };
        vec![vec![from_deg + turn, to_deg + turn, drop, first, last]]
    }
}

/// Returns that a model expects, and those that came.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    expected: f64,
    seen: f64,
}

/// The run of neighbours, at most half of them if they go round in a circle, that lacks returns most significantly against a base rate, by
/// the likelihood ratio of Poisson counts; in a circle it may end beyond the last.
fn worst_run(counts: &[Count], base: f64, circle: bool) -> Option<std::ops::Range<usize>> {
    let n = counts.len();
    let mut best = (1e-9, None);
    for from in 0..n {
        let mut run = Count::default();
        let longest = if circle { n / 2 } else { n - from };
        for length in 1..=longest {
            run = run.and(counts[(from + length - 1) % n]);
            let gain = run.gain(base);
            if run.rate() < base && gain > best.0 {
                best = (gain, Some(from..from + length));
            }
        }
    }
    best.1
}

impl Count {
    fn and(self, other: Self) -> Self {
        Self { expected: self.expected + other.expected, seen: self.seen + other.seen }
    }

    fn rate(self) -> f64 {
        self.seen / self.expected.max(1e-9)
    }

    /// Log-likelihood ratio of its own rate to another.
    fn gain(self, base: f64) -> f64 {
        let surprise = if self.seen < 0.5 { 0.0 } else { self.seen * (self.rate() / base).ln() };
        surprise - (self.seen - base * self.expected)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;

    use super::*;
    use crate::effects::trial::{Trial, sensor};

    #[test]
    fn a_fit_finds_a_sector_across_all_rings() {
        let trial = Trial::of(Arc::new(BlockedSector), &[40.0, 75.0, 0.6, -3.0, 18.0]);
        trial.each_within(&[1.0, 1.0, 0.1, f64::INFINITY, f64::INFINITY]);
    }

    #[test]
    fn a_fit_finds_a_spot_across_the_seam() {
        let trial = Trial::of(Arc::new(BlockedSector), &[165.0, 195.0, 0.9, 6.0, 11.0]);
        trial.each_within(&[1.0, 1.0, 0.1, 0.5, 0.5]);
    }

    #[test]
    fn an_edge_is_known_no_better_than_its_column() {
        let rays = Rays::new(&sensor(), &Device::flex());
        let open = BlockedSector.left_open(&[-20.0, 10.0, 0.8, 2.0, 9.0], &rays);
        assert!((open[0] - 360.0 / 256.0 / 12f64.sqrt()).abs() < 1e-9 && open[2] == 0.0, "{open:?}");
    }
}
