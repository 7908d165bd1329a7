//! Receivers that bright surfaces drive to their end: reflectance stops at a maximum.

use super::image::Ceiling;
use super::{About, ActsOn, Channel, Effect, Evidence, Image, Parameter, Values};

/// Finest step in which sensors report reflectance: nothing piles up in less.
const FINEST: f64 = 2e-4;

/// min(I + noise, maximum) + scatter. Reports pile up at the maximum if it is the digital end (no scatter), and lie around it if the receiver's
/// output is held before it is measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct Saturation;

impl Effect for Saturation {
    fn about(&self) -> About {
        About {
            name: "saturation",
            does: "reports no reflectance above {maximum}",
            channel: Channel::Reflectance,
            acts_on: ActsOn::REFLECTANCE,
            covariates: &["reflectance"],
            formula: "min(I, I_max)",
            source: "Tobin, Estimation of Relationships for Limited Dependent Variables (1958); HDL-64E S3 calibration files: maximum 230 of 255 on four lasers",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter { scale: 0.005, ..Parameter::free("maximum", 0.005, (0.05, 1.0)).from(1.0) },
            // A digital end has no scatter at all.
            Parameter::positive("scatter", 0.005, (0.0, 0.3)),
        ]
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let scatter = (values.one(1).square() + FINEST * FINEST).sqrt();
        image.ceiling = Some(Ceiling { maximum: values.one(0).clamp(0.02, 1.0), scatter });
        image
    }

    /// The likelihood of a maximum is flat above all reports, and a needle where they pile up.
    fn starts(&self, evidence: &Evidence) -> Vec<Vec<f64>> {
        let mut starts: Vec<Vec<f64>> = pile(evidence).into_iter().map(|maximum| vec![maximum, FINEST]).collect();
        // Where the brightest surfaces end up, if that is not what they are.
        for share in [0.01, 0.1] {
            let bright = Evidence::quantile(evidence.reflectance.iter().copied().filter(|i| *i > 0.0), 1.0 - share);
            let reports = |bright: f64| {
                let of = |(i, p): (usize, &f32)| {
                    (f64::from(*p) >= bright && evidence.measured_range_m[i] > 0.0)
                        .then(|| evidence.measured_reflectance[i])
                };
                Evidence::quantile(evidence.reflectance.iter().enumerate().filter_map(of), 0.5)
            };
            if let Some((bright, reported)) = bright.and_then(|b| Some((b, reports(b)?)))
                && (0.05..0.995).contains(&reported)
                && reported < bright
            {
                starts.push(vec![reported, 0.02]);
            }
        }
        starts
    }
}

/// The reflectance at which reports pile up, with next to none above.
fn pile(evidence: &Evidence) -> Option<f64> {
    let returned = |(i, m): (usize, &f32)| (evidence.measured_range_m[i] > 0.0).then_some(*m);
    let mut reports: Vec<f32> = evidence.measured_reflectance.iter().enumerate().filter_map(returned).collect();
    reports.sort_by(f32::total_cmp);
    let enough = (reports.len() / 2000).max(10);
    let mut above = 0;
    for same in reports.chunk_by(|a, b| b - a < FINEST as f32).rev() {
        let value = same[same.len() / 2];
        let long = same[same.len() - 1] - same[0] < 2.0 * FINEST as f32;
        if same.len() >= enough && long && (0.05..0.9999).contains(&value) {
            return Some(f64::from(value));
        }
        above += same.len();
        if above > reports.len() / 200 {
            return None;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::trial::Trial;

    #[test]
    fn a_fit_finds_where_reports_pile_up() {
        let trial = Trial::of(Arc::new(Saturation), &[0.5, FINEST]);
        assert!((trial.found[0] - 0.5).abs() < 2e-4, "{:?}", trial.found);
        assert!(trial.stderr[0] < 1e-3, "{:?}", trial.stderr);
    }

    #[test]
    fn a_fit_finds_what_reports_scatter_around() {
        for truth in [[0.4, 0.02], [0.7, 0.03]] {
            Trial::of(Arc::new(Saturation), &truth).found_within(0.02);
        }
    }
}
