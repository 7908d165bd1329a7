//! Checks that no value of any parameter, however absurd, makes a likelihood or its gradient anything but a number.

use std::sync::Arc;

use burn::tensor::Tensor;

use super::trial::{measured_by, sensor};
use super::{NoiseFloor, library};
use crate::closed_loop::likelihood::{range, reflectance, returns};
use crate::closed_loop::model::{SensorModel, Term};

/// How far from its start each number goes, in units of its typical size: as far as a fit that lost its way.
const FAR: [f64; 6] = [-60.0, -20.0, -3.0, 3.0, 20.0, 60.0];

#[test]
fn likelihoods_and_gradients_are_numbers_for_all_values() {
    let rings = sensor().rings().len();
    let batch = &measured_by(&SensorModel::ideal(rings), &sensor())[0];
    let noise = &SensorModel::ideal(rings).terms[0];
    let mut effects = library();
    effects.push(Arc::new(NoiseFloor));
    for effect in effects {
        let term = Term::new(Arc::clone(&effect), rings);
        // Each parameter alone, and all of them together.
        let mut parts: Vec<_> = term.layout().into_iter().map(|(_, range)| range).collect();
        parts.push(0..term.fitted.len());
        for (part, far) in parts.iter().flat_map(|part| FAR.map(|far| (part.clone(), far))) {
            let mut numbers: Vec<f32> = vec![0.2; term.fitted.len()];
            numbers[part.clone()].fill(far as f32);
            let numbers = Tensor::<1>::from_floats(numbers.as_slice(), &batch.image.device()).require_grad();
            let image = effect.forward(&term.values(&numbers), batch.image.clone()).resample();
            let image = if effect.about().name == noise.name() { image } else { noise.forward(image) };
            let nats = range(&image, &batch.observed, 0.0)
                + reflectance(&image, &batch.observed, 0.0)
                + returns(&image, &batch.observed);
            let sum = nats.sum();
            let value: f64 = sum.clone().into_scalar();
            let gradients = sum.backward();
            let slopes: Vec<f32> =
                numbers.grad(&gradients).map_or_else(Vec::new, |g| g.into_data().iter::<f32>().collect());
            let name = effect.about().name;
            assert!(value.is_finite(), "{name}: {value} at {far} for numbers {part:?}");
            assert!(slopes.iter().all(|s| s.is_finite()), "{name}: slopes {slopes:?} at {far} for numbers {part:?}");
        }
    }
}
