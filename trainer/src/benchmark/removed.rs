//! How much of the error that a perfect model would not make is gone on the scenes that the loop opens once, at the end.

use std::f64::consts::PI;

use hidden::{Channel, Defect, Range, Recipe};

use crate::closed_loop::metrics::Confirmation;

/// Share of the error before that has to be reducible: less says nothing about what was removed.
const LEAST_REDUCIBLE: f64 = 0.1;

/// (before − after) / (before − ceiling), the least over the channels that the defects act on; none where nothing is reducible.
///
/// Geometry and range are judged by the mean absolute error of ranges, reflectance by its own, missing and extra returns by the logarithmic
/// loss. The ceiling of the first two is what the set's noise alone gives, since a model that takes a bias for noise has a high ceiling of
/// its own. A defect that is itself noise of range has no such ceiling and is not judged.
pub(super) fn removed(confirmation: &Confirmation, recipe: &Recipe) -> Option<f64> {
    let channels = recipe.hidden.iter().filter(|defect| !is_noise(defect)).flat_map(Defect::channels);
    let shares = channels.filter_map(|channel| {
        let (metric, ceiling) = match channel {
            Channel::Geometry | Channel::Range => ("range_mae_m", Some(recipe.noise.range_sigma_m)),
            Channel::Reflectance => ("reflectance_mae", Some(recipe.noise.reflectance_sigma)),
            Channel::Missing | Channel::Extra => ("keep_log_loss", None),
        };
        let metric = confirmation.of(metric)?;
        // Mean absolute value of a normal number.
        let ceiling = ceiling.map_or(metric.ceiling, |sigma| metric.ceiling.min(sigma * (2.0 / PI).sqrt()));
        let reducible = metric.before.value - ceiling;
        let share = (metric.before.value - metric.after.value) / reducible;
        (reducible > LEAST_REDUCIBLE * metric.before.value).then_some(share)
    });
    shares.min_by(f64::total_cmp)
}

fn is_noise(defect: &Defect) -> bool {
    matches!(
        defect,
        Defect::Range(
            Range::RangeNoise { .. }
                | Range::MixedPixels { .. }
                | Range::IncidenceStretch { .. }
                | Range::Quantisation { .. }
        )
    )
}

#[cfg(test)]
mod tests {
    use hidden::{Recipe, small_sensor};

    use super::*;
    use crate::closed_loop::metrics::{EdgeRays, Metric};
    use crate::closed_loop::outcome::Interval;

    fn confirmed(before: f64, after: f64, ceiling: f64) -> Confirmation {
        let interval = |value| Interval { value, ci95: [value, value] };
        let metric =
            Metric { name: "range_mae_m", before: interval(before), after: interval(after), ceiling, drawn: None };
        Confirmation {
            metrics: vec![metric],
            got_worse: vec![],
            edge_rays: EdgeRays::default(),
            unexplained_returns_per_scan: 0.0,
        }
    }

    #[test]
    fn a_bias_that_is_taken_for_noise_is_not_removed() {
        let bias = Defect::from(Range::RangeOffset { offset_m: 0.05 });
        let recipe = Recipe::new(1, small_sensor(1), vec![bias]);
        let noise_m = recipe.noise.range_sigma_m * (2.0 / PI).sqrt();
        let share = |after, ceiling| removed(&confirmed(0.05, after, ceiling), &recipe);
        assert_eq!(share(noise_m, noise_m), Some(1.0));
        assert_eq!(share(0.05, 0.05), Some(0.0));
        assert_eq!(removed(&confirmed(noise_m, noise_m, noise_m), &recipe), None);
    }
}
