//! What is known of each ray, for the screening.

use crate::closed_loop::predicted::numbers;
use crate::effects::{Covariate, Image};

/// A covariate of every ray; NaN where the ray has none, such as the range of what is not hit.
#[derive(Clone, Debug)]
pub(super) struct Values {
    pub(super) covariate: Covariate,
    pub(super) values: Vec<f32>,
}

/// The covariates of an image, `size` being `[frame, ring, column]`.
pub(super) fn of(image: &Image, size: [usize; 3]) -> Vec<Values> {
    let hit = numbers(&image.surface.hit, size);
    let of = |covariate: Covariate| {
        let mut values = numbers(&covariate.of(image), size);
        if !is_of_the_sensor(covariate) {
            values.iter_mut().zip(&hit).filter(|(_, hit)| **hit <= 0.5).for_each(|(x, _)| *x = f32::NAN);
        }
        Values { covariate, values }
    };
    Covariate::ALL.into_iter().map(of).collect()
}

/// Whether every ray has it, whatever it hits.
fn is_of_the_sensor(covariate: Covariate) -> bool {
    matches!(covariate, Covariate::Ring | Covariate::Azimuth | Covariate::SweepPhase | Covariate::Frame)
}
