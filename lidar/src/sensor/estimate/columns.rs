//! The grid of a turn: at how many ticks, and each ring how far from them and from the spin axis.

use std::f64::consts::{PI, TAU};

use pulp::Arch;

use super::beams::Beam;
use super::in_column;
use super::line::median;
use crate::sensor::{MAX_COLUMNS, Ring};

/// How the firings of a turn lie.
#[derive(Clone, Debug)]
pub(super) enum Pitch {
    /// At these ticks, each ring in its own phase; `None` for a ring that alone would not tell them.
    Encoder { columns: usize, phases: Vec<Option<Phase>> },
    /// Evenly, but so many a turn.
    FreeRunning { per_turn: f64 },
    /// Who knows; about so many.
    Unknown { columns: usize },
}

/// How a ring's azimuths lie on a grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Phase {
    /// Distance of the beam from the spin axis.
    pub(super) lateral_m: f64,
    /// Azimuth of the points' centre in their columns, within half a column.
    pub(super) offset_rad: f64,
    /// Root mean square arc between the points and their columns' centres.
    pub(super) residual_m: f64,
}

/// Beams leave a sensor at most this far beside the spin axis.
const MAX_LATERAL_M: f64 = 0.06;

/// A grid of so many columns or fewer is searched: finer ones drown in the noise of any range.
const FINEST: usize = 9000;

/// Least concentration of a grid that is one. Random azimuths have 1/√points.
const LEAST: f64 = 0.6;

/// Rings and points a ring that the search looks at.
const SEEDS: usize = 3;
const SEED_POINTS: usize = 320;

/// Finds the number of ticks a turn at which the azimuths concentrate.
pub(super) fn find(beams: &[Beam]) -> Pitch {
    // A turn has at least as many ticks as a ring has points, were it not for second returns and rings told wrongly.
    let mut densest: Vec<f64> = beams.iter().map(|beam| beam.densest() as f64).collect();
    let fewest = (median(&mut densest) / 3.0).max(128.0).min(FINEST as f64) as usize;
    let mut by_far_points: Vec<(usize, &Beam)> = beams.iter().map(|beam| (far_points(beam), beam)).collect();
    by_far_points.sort_by_key(|(points, _)| std::cmp::Reverse(*points));
    let seeds: Vec<Seed> = by_far_points.iter().take(SEEDS).map(|(_, beam)| Seed::new(beam)).collect();
    let curves: Vec<Vec<f32>> = seeds.iter().map(|seed| seed.concentrations(fewest)).collect();
    let mean = |k: usize| curves.iter().map(|curve| f64::from(curve[k])).sum::<f64>() / curves.len().max(1) as f64;
    let means: Vec<f64> = (0..=FINEST.saturating_sub(fewest)).map(mean).collect();
    let highest = means.iter().copied().fold(0.0, f64::max);
    let unknown = Pitch::Unknown { columns: spacing_columns(beams) };
    if highest < LEAST {
        return unknown;
    }
    // Every multiple of a grid's number concentrates its points too; the smallest one is the grid. Its neighbours come before it.
    let Some(first) = means.iter().position(|c| *c >= 0.85 * highest) else { return unknown };
    let near = first..(first + 8).min(means.len());
    let Some(best) = near.max_by(|a, b| means[*a].total_cmp(&means[*b])) else { return unknown };
    let columns = fewest + best;
    let per_turn = median(&mut seeds.iter().map(|seed| seed.per_turn(columns)).collect::<Vec<_>>());
    if (per_turn - columns as f64).abs() > 0.08 {
        return Pitch::FreeRunning { per_turn };
    }
    // An encoder's ticks hold for every ring.
    let phases: Vec<Option<Phase>> = beams.iter().map(|beam| refine(beam, columns)).collect();
    let agree = beams.iter().zip(&phases).filter(|(beam, phase)| concentrates(beam, **phase, columns)).count();
    if agree * 10 < beams.len() * 9 {
        return Pitch::FreeRunning { per_turn };
    }
    Pitch::Encoder { columns, phases }
}

/// Mean length of the mean of exp(i·phase) over each ring's points.
pub(super) fn concentration(beams: &[Beam], rings: &[Ring], columns: usize) -> f64 {
    let (mut total, mut points) = (0.0, 0.0);
    for (beam, ring) in beams.iter().zip(rings) {
        for (azimuth, away) in beam.azimuth_rad.iter().zip(&beam.away_m) {
            let encoder = azimuth - ring.azimuth_offset_rad - beside_rad(ring.lateral_m, *away);
            total += (in_column(encoder, columns).0 * TAU).cos();
            points += 1.0;
        }
    }
    total / points
}

/// True if a ring's azimuths concentrate on this grid as an encoder's do: a grid of half a firing too few or too many still has 0.64.
fn concentrates(beam: &Beam, phase: Option<Phase>, columns: usize) -> bool {
    const ENCODER: f64 = 0.8;
    phase.is_some_and(|phase| {
        let ring = Ring { azimuth_offset_rad: phase.offset_rad, lateral_m: phase.lateral_m, ..Ring::default() };
        concentration(std::slice::from_ref(beam), &[ring], columns) >= ENCODER
    })
}

/// A ring's lateral distance and offset on a grid: the lateral distance at which its phases concentrate most, then least squares of the
/// arcs, since the noise of a point is the same number of millimetres at every range. `None` if they concentrate nowhere.
fn refine(beam: &Beam, columns: usize) -> Option<Phase> {
    let per_rad = columns as f64;
    let stride = beam.len().div_ceil(600);
    let sum = |lateral_m: f64| {
        let (mut re, mut im, mut n) = (0.0, 0.0, 0.0);
        for i in (0..beam.len()).step_by(stride) {
            let (sin, cos) = ((beam.azimuth_rad[i] - beside_rad(lateral_m, beam.away_m[i])) * per_rad).sin_cos();
            (re, im, n) = (re + cos, im + sin, n + 1.0);
        }
        (f64::hypot(re, im) / n, im.atan2(re) / per_rad)
    };
    let steps = (MAX_LATERAL_M * 1000.0) as i32;
    let (mut lateral_m, mut highest) = (0.0, 0.0);
    for step in -steps..=steps {
        let candidate_m = f64::from(step) * 0.001;
        let concentration = sum(candidate_m).0;
        if concentration > highest {
            (highest, lateral_m) = (concentration, candidate_m);
        }
    }
    if highest < LEAST {
        return None;
    }
    let column_rad = TAU / per_rad;
    let mut offset_rad = sum(lateral_m).1;
    let mut residual_m = 0.0;
    for _ in 0..8 {
        // Arc e·d = (Δoffset + Δlateral/√(d² − lateral²))·d over the points within a third of a column.
        let (mut aa, mut ab, mut bb, mut ae, mut be, mut ee, mut n) = (0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 0.0);
        for (azimuth, away) in beam.azimuth_rad.iter().zip(&beam.away_m) {
            let error = azimuth - beside_rad(lateral_m, *away) - offset_rad;
            let error = error - (error / column_rad).round() * column_rad;
            if error.abs() < column_rad / 3.0 {
                let (a, e) = (*away, error * away);
                let b = away / (away * away - lateral_m * lateral_m).max(1e-6).sqrt();
                (aa, ab, bb) = (aa + a * a, ab + a * b, bb + b * b);
                (ae, be, ee, n) = (ae + a * e, be + b * e, ee + e * e, n + 1.0);
            }
        }
        let determinant = aa * bb - ab * ab;
        if n < 2.0 || determinant <= 0.0 {
            break;
        }
        offset_rad += (ae * bb - be * ab) / determinant;
        lateral_m += (be * aa - ae * ab) / determinant;
        residual_m = (ee / n).sqrt();
    }
    // Columns' centres are half a column from straight behind.
    let (within, _) = in_column(offset_rad, columns);
    Some(Phase { lateral_m, offset_rad: within * column_rad, residual_m })
}

/// Angle by which a beam beside the axis is turned at a distance from it.
pub(super) fn beside_rad(lateral_m: f64, away_m: f64) -> f64 {
    (lateral_m / away_m).clamp(-1.0, 1.0).asin()
}

/// Some points of a ring, the far ones first: their azimuths depend little on where beside the axis the beam is.
struct Seed {
    azimuth_rad: Vec<f64>,
    away_m: Vec<f64>,
}

fn far_points(beam: &Beam) -> usize {
    beam.away_m.iter().filter(|away| **away > 15.0 && **away < 60.0).count()
}

impl Seed {
    fn new(beam: &Beam) -> Self {
        let mut nearest: Vec<f64> = beam.away_m.iter().copied().filter(|away| *away < 60.0).collect();
        nearest.sort_by(|a, b| b.total_cmp(a));
        let limit_m = nearest.get(4 * SEED_POINTS).copied().unwrap_or(0.0).min(15.0);
        let mut far: Vec<usize> =
            (0..beam.len()).filter(|i| beam.away_m[*i] >= limit_m && beam.away_m[*i] < 60.0).collect();
        // By no pattern: every second point of a ring that fires at every tick would lie on a grid of half as many.
        far.sort_unstable_by_key(|i| scrambled(*i as u32));
        far.truncate(SEED_POINTS);
        Self {
            azimuth_rad: far.iter().map(|i| beam.azimuth_rad[*i]).collect(),
            away_m: far.iter().map(|i| beam.away_m[*i]).collect(),
        }
    }

    /// For every number of columns from `fewest` to [`FINEST`], the highest concentration over all lateral distances.
    fn concentrations(&self, fewest: usize) -> Vec<f32> {
        let mut highest = vec![0.0f32; (FINEST + 1).saturating_sub(fewest)];
        for step in -15..=15 {
            let lateral_m = f64::from(step) * MAX_LATERAL_M / 15.0;
            // exp(i·n·azimuth) for n = fewest, then one multiplication by exp(i·azimuth) for each next n.
            let angles: Vec<f64> =
                self.azimuth_rad.iter().zip(&self.away_m).map(|(a, d)| a - beside_rad(lateral_m, *d)).collect();
            let unit = |n: f64| -> (Vec<f32>, Vec<f32>) {
                angles.iter().map(|a| ((a * n).cos() as f32, (a * n).sin() as f32)).unzip()
            };
            let (mut re, mut im) = unit(fewest as f64);
            let (turn_re, turn_im) = unit(1.0);
            Arch::new().dispatch(|| sweep(&mut re, &mut im, &turn_re, &turn_im, &mut highest));
        }
        highest
    }

    /// The real number of firings a turn near `columns` at which the azimuths concentrate most; `columns` unless another one is clearly
    /// better, for a few points fit many.
    fn per_turn(&self, columns: usize) -> f64 {
        let (mut best, mut whole) = ((0.0, columns as f64), 0.0f64);
        for step in -15..=15 {
            let lateral_m = f64::from(step) * MAX_LATERAL_M / 15.0;
            for part in -25..=25 {
                let per_turn = columns as f64 + f64::from(part) * 0.04;
                let (mut re, mut im) = (0.0, 0.0);
                for (azimuth, away) in self.azimuth_rad.iter().zip(&self.away_m) {
                    let (sin, cos) = ((azimuth - beside_rad(lateral_m, *away)) * per_turn).sin_cos();
                    (re, im) = (re + cos, im + sin);
                }
                let concentration = f64::hypot(re, im);
                if part == 0 {
                    whole = whole.max(concentration);
                }
                if concentration > best.0 {
                    best = (concentration, per_turn);
                }
            }
        }
        if best.0 > 1.01 * whole { best.1 } else { columns as f64 }
    }
}

/// A number that seems random but is always the same (Wellons' `lowbias32`).
fn scrambled(i: u32) -> u32 {
    let i = (i ^ (i >> 16)).wrapping_mul(0x7feb_352d);
    let i = (i ^ (i >> 15)).wrapping_mul(0x846c_a68b);
    i ^ (i >> 16)
}

/// Raises `highest` to the length of the mean of the unit numbers, turning them after each entry.
#[inline]
fn sweep(re: &mut [f32], im: &mut [f32], turn_re: &[f32], turn_im: &[f32], highest: &mut [f32]) {
    let per_point = 1.0 / re.len().max(1) as f32;
    for highest in highest {
        let (mut sum_re, mut sum_im) = ([0.0f32; 16], [0.0f32; 16]);
        let numbers = re.chunks_exact_mut(16).zip(im.chunks_exact_mut(16));
        for ((re, im), (tr, ti)) in numbers.zip(turn_re.chunks_exact(16).zip(turn_im.chunks_exact(16))) {
            for k in 0..16 {
                sum_re[k] += re[k];
                sum_im[k] += im[k];
                (re[k], im[k]) = (re[k] * tr[k] - im[k] * ti[k], re[k] * ti[k] + im[k] * tr[k]);
            }
        }
        let (sum_re, sum_im) = (sum_re.iter().sum::<f32>(), sum_im.iter().sum::<f32>());
        *highest = highest.max(sum_re.hypot(sum_im) * per_point);
    }
}

/// Columns as wide as the usual step between neighbouring azimuths of the densest scan.
fn spacing_columns(beams: &[Beam]) -> usize {
    let mut steps = Vec::new();
    for beam in beams {
        let end = beam.ends.first().copied().unwrap_or(0);
        let mut azimuths = beam.azimuth_rad[..end].to_vec();
        azimuths.sort_by(f64::total_cmp);
        steps.extend(azimuths.windows(2).map(|w| w[1] - w[0]).filter(|step| *step > 1e-5));
    }
    let step = median(&mut steps).clamp(TAU / MAX_COLUMNS as f64, PI / 8.0);
    ((TAU / step).ceil() as usize).min(MAX_COLUMNS)
}
