//! How real reflectances scatter about what a model says of them, measured on real scans and drawn inside the model's graph.
//!
//! A network that learns from pairs answers with the middle of what a sensor may report: its walls and roads are smooth. What it cannot know, a
//! surface's paint and the sensor's own noise, a real scan shows all the same.

mod graph;

use std::fmt;

use anyhow::{Result, ensure};

use crate::data::holes::Pixel;
use crate::data::sample::Sample;
use crate::generator::Answer;

/// Shares of the rays, and the standard normal numbers below which as many lie: where quantiles are measured.
const LEVELS: [(f64, f64); 11] = [
    (0.001, -3.090_232),
    (0.01, -2.326_348),
    (0.05, -1.644_854),
    (0.15, -1.036_433),
    (0.3, -0.524_401),
    (0.5, 0.0),
    (0.7, 0.524_401),
    (0.85, 1.036_433),
    (0.95, 1.644_854),
    (0.99, 2.326_348),
    (0.999, 3.090_232),
];

/// Shares of the rays of which a model says less than is said at a knot; between knots quantiles are interpolated.
const KNOTS: [f64; 9] = [0.0, 0.02, 0.1, 0.25, 0.5, 0.75, 0.9, 0.98, 1.0];

/// Rays that it takes at least.
const LEAST_RAYS: usize = 10_000;

/// Numbers of columns between two rays whose scatter is compared.
const LAGS: [usize; 9] = [1, 2, 3, 4, 6, 8, 12, 16, 24];

/// Steps from one length that is tried to the next.
const LENGTH_STEP: f64 = 1.1;

/// How far from what a model says reflectances are reported, and how this hangs together along a ring.
///
/// The reflectance of a ray is Q(s, z), s being what the model says and z a standard normal number. Q is linear between knots in both. The numbers
/// of two rays of a ring that lie Δ of azimuth apart, not 0, are correlated by
///
/// > ρ = share · exp(−Δ / azimuth).
///
/// What neighbours share is what the model does not know of a surface; what is left, 1 − share of the variance of z, is the ray's own. That alone is
/// drawn: the rest, drawn along rings and across them, lay over streets as clouds that keep to no surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Scatter {
    /// Knots in s, ascending.
    said: Vec<f32>,
    /// Q at each of them and each of the [`LEVELS`].
    measured: Vec<[f32; LEVELS.len()]>,
    /// See above.
    share: f64,
    /// See above.
    azimuth_deg: f64,
}

/// A scan's rays: what the model says and what was measured; nothing where one of them is missing. Rows are rings.
type Rows = Vec<Vec<Option<(f32, f32)>>>;

impl Scatter {
    /// Measures it in real scans that were made to look simulated, with a model's answers to them; columns lie `column_deg` apart.
    ///
    /// # Errors
    /// If there are too few returns.
    pub fn measure(answered: &[(Sample, Answer)], column_deg: f64) -> Result<Self> {
        let scans: Vec<Rows> = answered.iter().map(|(sample, answer)| rows(sample, answer)).collect();
        let mut pairs: Vec<(f32, f32)> = scans.iter().flatten().flatten().copied().flatten().collect();
        let found = pairs.len();
        ensure!(found >= LEAST_RAYS, "{found} returns, expected {LEAST_RAYS} or more");
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut said: Vec<f32> = KNOTS.iter().map(|share| pairs[(share * (found - 1) as f64) as usize].0).collect();
        said.dedup();
        let measured = (0..said.len()).map(|k| quantiles(&pairs, &said, k)).collect();
        let level = Self { said, measured, share: 0.0, azimuth_deg: 1.0 };
        let numbers: Vec<_> = scans.into_iter().map(|scan| level.numbers(scan)).collect();
        Ok(level.correlated(&numbers, column_deg))
    }

    /// Quantiles of what is measured, by what the model says.
    pub fn to_table(&self) -> String {
        let cells = |row: &[String]| format!("| {} |\n", row.join(" | "));
        let mut head = vec!["the model says".to_owned()];
        head.extend(LEVELS.iter().map(|(level, _)| format!("{} % below", 100.0 * level)));
        let mut out = cells(&head) + &cells(&vec!["---".to_owned(); head.len()]);
        for (said, quantiles) in self.said.iter().zip(&self.measured) {
            let row: Vec<String> = [said].into_iter().chain(quantiles).map(|x| format!("{x:.3}")).collect();
            out += &cells(&row);
        }
        out
    }

    /// Each ray's z.
    fn numbers(&self, scan: Rows) -> Vec<Vec<Option<f64>>> {
        let row = |row: Vec<Option<_>>| row.into_iter().map(|ray| ray.map(|(said, found)| self.number(said, found)));
        scan.into_iter().map(|rays| row(rays).collect()).collect()
    }

    /// The z that has this reflectance reported where that one is said; the middle of them where several have.
    fn number(&self, said: f32, found: f32) -> f64 {
        let quantiles = self.at(said);
        let reached = |below: &dyn Fn(f32) -> bool| {
            let i = quantiles.iter().take_while(|q| below(**q)).count();
            if i == 0 || i == LEVELS.len() {
                return LEVELS[i.min(LEVELS.len() - 1)].1;
            }
            let (low, high) = (f64::from(quantiles[i - 1]), f64::from(quantiles[i]));
            let part = if high > low { ((f64::from(found) - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 };
            LEVELS[i - 1].1 + part * (LEVELS[i].1 - LEVELS[i - 1].1)
        };
        f64::midpoint(reached(&|q| q < found), reached(&|q| q <= found))
    }

    /// Q at each of the levels, where a model says this.
    fn at(&self, said: f32) -> [f32; LEVELS.len()] {
        let weights = (0..self.said.len()).map(|k| weight(&self.said, k, said));
        let mut sum = [0.0; LEVELS.len()];
        for (weight, quantiles) in weights.zip(&self.measured) {
            sum.iter_mut().zip(quantiles).for_each(|(sum, quantile)| *sum += weight * quantile);
        }
        sum
    }

    /// The same with the correlation of these numbers, by least squares in ρ.
    fn correlated(self, scans: &[Vec<Vec<Option<f64>>>], column_deg: f64) -> Self {
        let (mut sum, mut rays) = ([0.0; 2], 0.0);
        for z in scans.iter().flatten().flatten().flatten() {
            (sum, rays) = ([sum[0] + z, sum[1] + z * z], rays + 1.0);
        }
        let mean = sum[0] / rays;
        let variance = sum[1] / rays - mean * mean;
        if variance < 1e-6 {
            return self;
        }
        let correlation = |columns: usize| {
            let (mut sum, mut pairs) = (0.0, 0.0);
            for row in scans.iter().flatten().filter(|row| columns < row.len()) {
                for (a, b) in row.iter().zip(&row[columns..]) {
                    if let (Some(a), Some(b)) = (a, b) {
                        (sum, pairs) = (sum + (a - mean) * (b - mean), pairs + 1.0);
                    }
                }
            }
            if pairs > 0.0 { sum / pairs / variance } else { 0.0 }
        };
        let along = LAGS.map(|lag| (lag as f64 * column_deg, correlation(lag)));
        let longest = 2.0 * along[LAGS.len() - 1].0;
        let lengths =
            std::iter::successors(Some(column_deg / 2.0), |l| Some(l * LENGTH_STEP)).take_while(|l| *l <= longest);
        let fitted = lengths.map(|length| {
            let decay = along.map(|(azimuth_deg, _)| (-azimuth_deg / length).exp());
            let dot = |a: [f64; LAGS.len()], b: [f64; LAGS.len()]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let found = along.map(|(_, rho)| rho);
            let share = (dot(decay, found) / dot(decay, decay)).clamp(0.0, 1.0);
            let error: f64 = decay.iter().zip(found).map(|(d, rho)| (share * d - rho).powi(2)).sum();
            (error, share, length)
        });
        let Some((_, share, azimuth_deg)) = fitted.min_by(|a, b| a.0.total_cmp(&b.0)) else { return self };
        Self { share, azimuth_deg, ..self }
    }
}

/// How much the k-th knot counts at x; together they count 1.
fn weight(knots: &[f32], k: usize, x: f32) -> f32 {
    let last = knots.len() - 1;
    let x = x.clamp(knots[0], knots[last]);
    let rising = if k == 0 { 1.0 } else { (x - knots[k - 1]) / (knots[k] - knots[k - 1]) };
    let falling = if k == last { 1.0 } else { (knots[k + 1] - x) / (knots[k + 1] - knots[k]) };
    rising.min(falling).clamp(0.0, 1.0)
}

/// Quantiles of what was measured where a model said about what the k-th knot is; `pairs` ascend by what it said.
fn quantiles(pairs: &[(f32, f32)], knots: &[f32], k: usize) -> [f32; LEVELS.len()] {
    let (from, to) = (knots[k.saturating_sub(1)], knots[(k + 1).min(knots.len() - 1)]);
    let near = &pairs[pairs.partition_point(|(said, _)| *said < from)..pairs.partition_point(|(said, _)| *said <= to)];
    let mut weighed: Vec<(f32, f32)> = near.iter().map(|(said, found)| (*found, weight(knots, k, *said))).collect();
    weighed.sort_by(|a, b| a.0.total_cmp(&b.0));
    let all: f64 = weighed.iter().map(|(_, weight)| f64::from(*weight)).sum();
    let mut levels = LEVELS.iter().map(|(level, _)| level * all);
    let (mut out, mut below, mut next, mut filled) = ([0.0; LEVELS.len()], 0.0, levels.next(), 0);
    for (found, weight) in weighed {
        below += f64::from(weight);
        while next.is_some_and(|level| level <= below) {
            out[filled] = found;
            (next, filled) = (levels.next(), filled + 1);
        }
    }
    out
}

/// Rays that were reported and left as they were.
fn rows(sample: &Sample, answer: &Answer) -> Rows {
    let said = answer.reflectance.iter().zip(sample.real.reflectance());
    let rays: Vec<_> =
        sample.pixel.iter().zip(said).map(|(pixel, (s, r))| (*pixel == Pixel::Kept).then_some((*s, *r))).collect();
    rays.chunks(sample.real.columns()).map(<[_]>::to_vec).collect()
}

impl fmt::Display for Scatter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let own = 1.0 - self.share;
        write!(f, "{own:.3} of the variance a ray's own, the rest shared along rings over {:.2}°", self.azimuth_deg)
    }
}
