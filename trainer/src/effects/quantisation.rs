//! Ranges in multiples of a step.

use super::image::Quantum;
use super::{About, ActsOn, Channel, Effect, Evidence, Image, Parameter, Values};

/// Steps that are looked for, in m.
const STEPS_M: (f64, f64) = (1e-3, 0.3);
/// Ranges up to here are enough to find a step roughly, in m.
const NEAR_M: f64 = 25.0;
/// Ranges that the first search looks at.
const SAMPLE: usize = 2000;
/// Strength of a comb from which on it is worth a fit: the strongest of 50 000 frequencies without one is about 0.09.
const FAINTEST: f64 = 0.15;
/// Sharpest tooth in m: single-precision points know their range to a few micrometres.
const SHARPEST_M: f64 = 5e-6;

/// q·round(r/q), the teeth blurred by what noise comes after.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quantisation;

impl Effect for Quantisation {
    fn about(&self) -> About {
        About {
            name: "quantisation",
            does: "reports ranges in multiples of {step_m}",
            channel: Channel::Range,
            acts_on: ActsOn::RANGE,
            covariates: &["range"],
            formula: "q·round(r/q)",
            source: "HDL-64E S2 user's manual: 2 mm; Widrow and Kollár, Quantization Noise (2008)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            // Beside a step of a millimetre with teeth as wide, any noise looks smooth: that does nothing.
            Parameter::found("step_m", 1e-3, 1e-6, (STEPS_M.0, STEPS_M.1)),
            // Teeth may be as sharp as numbers are.
            Parameter::positive("tooth_m", 1e-3, (0.0, 0.1)),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let tooth_m = values.one(1).clamp(SHARPEST_M, 1.0);
        image.quantum = Some(Quantum { step_m: values.one(0).clamp(1e-4, 1e3), tooth_m });
        image
    }

    fn starts(&self, evidence: &Evidence) -> Vec<Vec<f64>> {
        step(evidence).into_iter().collect()
    }
}

/// The step and the tooth, if ranges come in steps: the strongest line of their spectrum that the scene does not have as well.
fn step(evidence: &Evidence) -> Option<Vec<f64>> {
    let pairs = evidence.measured_range_m.iter().zip(&evidence.range_m).map(|(z, r)| (f64::from(*z), f64::from(*r)));
    let close = pairs.filter(|(z, r)| *z > 0.0 && *r > 0.0 && (z - r).abs() < 0.5);
    let all: Vec<(f64, f64)> = close.collect();
    let near: Vec<(f64, f64)> = all.iter().copied().filter(|(z, _)| *z < NEAR_M).collect();
    if near.len() < 200 {
        return None;
    }
    let sample: Vec<(f64, f64)> = near.iter().copied().step_by(near.len().div_ceil(SAMPLE)).collect();
    let strengths = spectrum(&sample);
    let strongest = strengths.iter().map(|(_, s)| *s).fold(0.0, f64::max);
    if strongest < FAINTEST {
        return None;
    }
    // Sharp teeth have lines at all multiples of their frequency: the lowest is the step's.
    let first = strengths.iter().find(|(_, s)| *s > 0.75 * strongest)?.0;
    let finer = (-60..=60).map(|i| first + f64::from(i) * 1e-3);
    let best = finer.map(|f| (f, line(&sample, f))).max_by(|a, b| a.1.total_cmp(&b.1))?.0;
    let step_m = refined(&all, refined(&near, 1.0 / best));
    let beyond = all.iter().map(|(z, _)| (z - (z / step_m).round() * step_m).abs() as f32);
    let tooth_m = (1.5 * Evidence::quantile(beyond, 0.5)?).clamp(2.0 * SHARPEST_M, 0.3 * step_m);
    Some(vec![step_m, tooth_m])
}

/// Strength of the comb at each frequency, per metre, less what smooth noise around the prediction would leave of the scene's own lines.
fn spectrum(sample: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let n = sample.len() as f64;
    let spread = Evidence::quantile(sample.iter().map(|(z, r)| (z - r).abs() as f32), 0.5).unwrap_or(0.0) * 1.48;
    let (from, to, df) = (1.0 / STEPS_M.1, 1.0 / STEPS_M.0, 0.5 / NEAR_M);
    // Each sample turns by a constant angle from one frequency to the next.
    let turn = |x: f64, f: f64| (2.0 * std::f64::consts::PI * f * x).sin_cos();
    let mut measured: Vec<[f64; 4]> = sample.iter().map(|(z, _)| wheel(turn(*z, from), turn(*z, df))).collect();
    let mut scene: Vec<[f64; 4]> = sample.iter().map(|(_, r)| wheel(turn(*r, from), turn(*r, df))).collect();
    let count = ((to - from) / df) as usize;
    (0..count)
        .map(|k| {
            let f = from + k as f64 * df;
            let (mut re, mut im) = advance(&mut measured);
            let left = (-2.0 * (std::f64::consts::PI * spread * f).powi(2)).exp();
            if left > 1e-3 {
                let (scene_re, scene_im) = advance(&mut scene);
                re -= left * scene_re;
                im -= left * scene_im;
            }
            (f, re.hypot(im) / n)
        })
        .collect()
}

fn wheel((sin, cos): (f64, f64), (turn_sin, turn_cos): (f64, f64)) -> [f64; 4] {
    [cos, sin, turn_cos, turn_sin]
}

/// The sum of the wheels' positions, which then turn on.
fn advance(wheels: &mut [[f64; 4]]) -> (f64, f64) {
    let mut sum = (0.0, 0.0);
    for wheel in wheels {
        let [re, im, turn_re, turn_im] = *wheel;
        sum = (sum.0 + re, sum.1 + im);
        (wheel[0], wheel[1]) = (re * turn_re - im * turn_im, re * turn_im + im * turn_re);
    }
    sum
}

/// Strength of the line at a frequency.
fn line(sample: &[(f64, f64)], f: f64) -> f64 {
    let turns = sample.iter().map(|(z, _)| (2.0 * std::f64::consts::PI * f * z).sin_cos());
    let (sin, cos) = turns.fold((0.0, 0.0), |(s, c), (sin, cos)| (s + sin, c + cos));
    sin.hypot(cos) / sample.len() as f64
}

/// The step that fits best, by least squares over the multiples that its neighbourhood gives.
fn refined(pairs: &[(f64, f64)], step_m: f64) -> f64 {
    let mut step_m = step_m;
    for _ in 0..4 {
        let (zn, nn) = pairs.iter().fold((0.0, 0.0), |(zn, nn), (z, _)| {
            let n = (z / step_m).round();
            (zn + z * n, nn + n * n)
        });
        step_m = zn / nn;
    }
    step_m
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_search_finds_the_step_below_and_above_the_noise() {
        for step_m in [0.002, 0.0125, 0.05, 0.2] {
            let trial = Trial::of(Arc::new(Quantisation), &[step_m, 1e-5]);
            assert!((trial.found[0] / step_m - 1.0).abs() < 1e-5, "{:?} for {step_m}", trial.found);
            assert!(trial.found[1] < 0.1 * step_m, "{:?} for {step_m}", trial.found);
        }
    }

    #[test]
    fn no_step_is_found_in_smooth_noise() {
        let trial = Trial::of(Arc::new(Quantisation), &[1e-3, 1e-2]);
        assert_eq!(trial.found[0], 1e-3, "{:?}", trial.found);
        assert!(trial.found[1] > 3e-4, "{:?}", trial.found);
    }
}
