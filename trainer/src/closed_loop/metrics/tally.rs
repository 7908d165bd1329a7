//! One frame's sums: what was measured, against what somebody says of it.

use lidar::RangeImage;
use lidar::metrics::PROBABILITY_MARGIN;

use super::chamfer::{Cloud, chamfer};
use crate::closed_loop::predicted::Predicted;

/// A frame's share of each metric, as (sum, of how many).
#[derive(Clone, Debug)]
pub(super) struct Tally {
    pub(super) metrics: [(f64, f64); 8],
    /// Σ distance of returns at edges, and their number.
    pub(super) edge: (f64, f64),
}

/// What somebody says of each ray of a frame.
#[derive(Clone, Debug)]
pub(super) struct Guess<'a> {
    /// m, 0 = none.
    range_m: &'a [f32],
    reflectance: &'a [f32],
    keep: Vec<f32>,
    /// Returns that no surface explains.
    extra: f64,
}

/// A measured frame, and what both models say of it.
pub(super) struct Frame<'a> {
    models: [&'a Predicted; 2],
    from: usize,
    rays: usize,
    measured: Cloud,
    directions: &'a [Vec<f32>; 3],
}

impl<'a> Guess<'a> {
    /// The medians of a model.
    pub(super) fn of_model(model: &'a Predicted, frame: usize) -> Self {
        let rays = frame * model.rays()..(frame + 1) * model.rays();
        Self {
            range_m: &model.range_m[rays.clone()],
            reflectance: &model.median_reflectance[rays.clone()],
            keep: model.reported[rays.clone()].to_vec(),
            extra: model.extra[rays].iter().map(|p| f64::from(*p)).sum(),
        }
    }

    /// A scan.
    pub(super) fn of_scan(scan: &'a RangeImage, frame: &Frame<'_>) -> Self {
        let range_m = scan.range_m();
        let keep = range_m.iter().map(|r| if *r > 0.0 { 1.0 } else { 0.0 }).collect();
        let extra = (0..frame.rays).filter(|i| range_m[*i] > 0.0 && !frame.explains(*i, range_m[*i])).count() as f64;
        Self { range_m, reflectance: scan.reflectance(), keep, extra }
    }
}

impl<'a> Frame<'a> {
    pub(super) fn new(models: [&'a Predicted; 2], frame: usize, directions: &'a [Vec<f32>; 3]) -> Self {
        let rays = models[1].rays();
        let from = frame * rays;
        let measured = Cloud::new(&models[1].measured_range_m[from..from + rays], directions);
        Self { models, from, rays, measured, directions }
    }

    fn measured_m(&self, i: usize) -> f32 {
        self.models[1].measured_range_m[self.from + i]
    }

    fn is_certain(&self, i: usize) -> bool {
        self.models.iter().all(|m| m.certain[self.from + i])
    }

    /// Whether a return at this range could be one of the surface that either model knows.
    fn explains(&self, i: usize, range_m: f32) -> bool {
        let i = self.from + i;
        self.models.iter().any(|m| m.hit[i] > 0.5 && (range_m - m.range_m[i]).abs() <= m.gate[i] * m.sigma_m[i])
    }

    /// Whether a ray's reflectance is compared.
    fn shows(&self, i: usize) -> bool {
        let hit = |m: &&Predicted| m.hit[self.from + i] > 0.5;
        self.measured_m(i) > 0.0 && self.is_certain(i) && self.models.iter().all(hit)
    }

    /// Whether a ray's range is compared.
    fn counts(&self, i: usize) -> bool {
        self.shows(i) && self.explains(i, self.measured_m(i))
    }

    fn is_unexplained(&self, i: usize) -> bool {
        self.measured_m(i) > 0.0 && self.is_certain(i) && !self.explains(i, self.measured_m(i))
    }

    pub(super) fn edges(&self) -> usize {
        (0..self.rays).filter(|i| !self.is_certain(*i)).count()
    }

    pub(super) fn unexplained(&self) -> usize {
        (0..self.rays).filter(|i| self.is_unexplained(*i)).count()
    }

    pub(super) fn tally(&self, guess: &Guess<'_>) -> Tally {
        let mut metrics = [(0.0, 0.0); 8];
        let mut edge = (0.0, 0.0);
        let mut add = |metric: usize, x: f64| {
            metrics[metric].0 += x;
            metrics[metric].1 += 1.0;
        };
        for i in 0..self.rays {
            let keep = f64::from(guess.keep[i]);
            let returned = self.measured_m(i) > 0.0;
            let likely = if returned { keep } else { 1.0 - keep };
            add(3, -likely.clamp(PROBABILITY_MARGIN, 1.0 - PROBABILITY_MARGIN).ln());
            add(4, (1.0 - likely).powi(2));
            if !returned || guess.range_m[i] <= 0.0 {
                continue;
            }
            let off_m = f64::from(guess.range_m[i] - self.measured_m(i));
            // A scan's extra returns are counted as such.
            if self.counts(i) && self.explains(i, guess.range_m[i]) {
                add(0, off_m.abs());
                add(1, off_m * off_m);
                add(2, off_m);
            }
            if self.shows(i) {
                let measured = self.models[1].measured_reflectance[self.from + i];
                add(5, f64::from((guess.reflectance[i] - measured).abs()));
            }
            if !self.is_certain(i) {
                edge = (edge.0 + off_m.abs(), edge.1 + 1.0);
            }
        }
        add(6, (guess.extra - self.unexplained() as f64).abs());
        let likely = guess.range_m.iter().zip(&guess.keep).map(|(r, keep)| if *keep > 0.5 { *r } else { 0.0 });
        add(7, chamfer(&Cloud::new(&likely.collect::<Vec<_>>(), self.directions), &self.measured));
        Tally { metrics, edge }
    }

    /// What the model after would score if it were the truth, on the same rays: its own noise. `drawn` is a scan of it.
    pub(super) fn ceiling(&self, drawn: &RangeImage) -> Tally {
        let model = self.models[1];
        let mut metrics = [(0.0, 0.0); 8];
        let mut add = |metric: usize, x: f64| {
            metrics[metric].0 += x;
            metrics[metric].1 += 1.0;
        };
        for i in 0..self.rays {
            let p = f64::from(model.reported[self.from + i]);
            add(3, entropy(p));
            add(4, p * (1.0 - p));
            if self.counts(i) {
                let sigma_m = f64::from(model.sigma_m[self.from + i]);
                add(0, sigma_m * (2.0 / std::f64::consts::PI).sqrt());
                add(1, sigma_m * sigma_m);
                add(2, 0.0);
            }
            if self.shows(i) {
                add(5, f64::from(model.least_reflectance_error[self.from + i]));
            }
        }
        let rays = self.from..self.from + self.rays;
        add(6, poisson_deviation(model.extra[rays.clone()].iter().map(|p| f64::from(*p)).sum()));
        let likely = model.range_m[rays.clone()].iter().zip(&model.reported[rays]);
        let likely: Vec<f32> = likely.map(|(r, keep)| if *keep > 0.5 { *r } else { 0.0 }).collect();
        let drawn = Cloud::new(drawn.range_m(), self.directions);
        add(7, chamfer(&Cloud::new(&likely, self.directions), &drawn));
        Tally { metrics, edge: (0.0, 0.0) }
    }
}

/// Of a yes or no, in nats.
fn entropy(p: f64) -> f64 {
    let of = |p: f64| if p > 0.0 { -p * p.ln() } else { 0.0 };
    of(p) + of(1.0 - p)
}

/// Mean absolute deviation of a Poisson number from its mean λ: 2·e^−λ·λ^(⌊λ⌋ + 1)/⌊λ⌋! (Crow, Biometrika 45, 1958).
fn poisson_deviation(mean: f64) -> f64 {
    if mean <= 0.0 {
        return 0.0;
    }
    let whole = mean.floor();
    let log_factorial: f64 = (1..=whole as u64).map(|k| (k as f64).ln()).sum();
    2.0 * (-mean + (whole + 1.0) * mean.ln() - log_factorial).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_poisson_number_deviates_as_its_probabilities_say() {
        for mean in [0.3f64, 1.0, 4.7, 60.0] {
            let mut probability = (-mean).exp();
            let mut deviation = 0.0;
            for k in 0..400 {
                deviation += probability * (f64::from(k) - mean).abs();
                probability *= mean / f64::from(k + 1);
            }
            assert!((poisson_deviation(mean) - deviation).abs() < 1e-9, "{mean}");
        }
    }

    #[test]
    fn a_coin_has_ln_2_of_entropy() {
        assert!((entropy(0.5) - 2f64.ln()).abs() < 1e-12);
        assert!(entropy(0.0).abs() < 1e-12 && entropy(1.0).abs() < 1e-12);
    }
}
