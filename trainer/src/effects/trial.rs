//! What the effects' tests share: streets seen by a small sensor that has an effect, and a fit that has to find it again.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use lidar::{RangeImage, Sensor};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, cast};

use super::{Effect, Image, draw::NOISE_CHANNELS};
use crate::closed_loop::data::{Batch, Pair, batches};
use crate::closed_loop::evidence::evidence;
use crate::closed_loop::fit::{Fitted, Free, Manner, On, fit, stderr};
use crate::closed_loop::model::{SensorModel, Term};
use crate::closed_loop::score::Scope;

/// Streets in a trial, a frame each.
const STREETS: u64 = 3;

/// An effect that stood a trial.
pub(crate) struct Trial {
    /// What the sensor had, physical values in a row.
    pub(crate) truth: Vec<f64>,
    /// What the fit found.
    pub(crate) found: Vec<f64>,
    /// Its standard errors.
    pub(crate) stderr: Vec<f64>,
}

impl Trial {
    /// Draws scans of a sensor whose effect has these physical values, by the effect's own forward pass, and fits.
    pub(crate) fn of(effect: Arc<dyn Effect>, truth: &[f64]) -> Self {
        let rings = sensor().rings().len();
        let mut model = SensorModel::ideal(rings);
        model.terms[0] = model.terms[0].clone().at(&[0.02, 0.02, 0.05, 1e-4, 1e-4]);
        model.terms.push(Term::new(Arc::clone(&effect), rings).at(truth));
        Self { truth: truth.to_vec(), ..Self::on(effect, &measured_by(&model, &sensor())) }
    }

    /// Fits an effect to these data, whose truth is not told.
    pub(crate) fn on(effect: Arc<dyn Effect>, data: &[Batch]) -> Self {
        let refs: Vec<&Batch> = data.iter().collect();
        let rings = sensor().rings().len();
        let term = Term::new(effect, rings);
        let acts_on = term.effect.about().acts_on;
        let on = On { batches: &refs, channels: acts_on, scope: Scope::All };
        let ideal = SensorModel::ideal(rings);
        let ideal = ideal.clone().with_noise_of(&evidence(&ideal, &refs));
        let noise = Free::noise(ideal.terms[0].clone(), acts_on);
        let level = SensorModel { terms: fit(&ideal, &[noise], &on, Manner::EXACT).terms };
        let noise = Free::noise(level.terms[0].clone(), acts_on);
        let starts = term.effect.starts(&evidence(&level, &refs));
        let starts = starts.iter().map(|start| term.clone().at(start));
        let starts: Vec<Term> = if starts.len() == 0 { vec![term] } else { starts.collect() };
        let from = |term: Term| {
            let widths: &[f64] = if term.is_geometric() { &[0.3, 0.06] } else { &[] };
            fit(&level, &[noise.clone(), Free::all(term)], &on, Manner { widths, ..Manner::EXACT })
        };
        let fits = starts.into_iter().map(from);
        let fitted: Fitted = fits.max_by(|a, b| a.log_likelihood.total_cmp(&b.log_likelihood)).expect("a start");
        let free = [Free::noise(fitted.terms[0].clone(), acts_on), Free::all(fitted.terms[1].clone())];
        let stderr = fitted.terms[1].physical_stderr(&stderr(&level, &free, &on)[1]);
        Self { truth: vec![], found: fitted.terms[1].physical(), stderr }
    }

    /// Asserts that every number was found within five standard errors, and that these are no larger than `largest`.
    pub(crate) fn found_within(&self, largest: f64) {
        self.each_within(&vec![largest; self.truth.len()]);
    }

    /// The same with a largest standard error for each number; an infinite one is for numbers that nothing depends on.
    pub(crate) fn each_within(&self, largest: &[f64]) {
        println!("truth {:?}\nfound {:?}\n    ± {:?}", self.truth, self.found, self.stderr);
        for (i, (truth, largest)) in self.truth.iter().zip(largest).enumerate().filter(|(_, (_, l))| l.is_finite()) {
            let (found, stderr) = (self.found[i], self.stderr[i]);
            assert!(stderr < *largest, "number {i}: standard error {stderr}, found {found} for {truth}");
            assert!((found - truth).abs() < 5.0 * stderr, "number {i}: found {found} ± {stderr} for {truth}");
        }
    }
}

/// 16 rings of 256 columns.
pub(crate) fn sensor() -> Sensor {
    let elevations: Vec<f64> = (0..16).map(|k| 3.0 - 1.6 * f64::from(k)).collect();
    Sensor::from_elevations_deg("trial", elevations, 256, (1.0, 100.0), 10.0).expect("a sensor")
}

/// What a sensor of this model measures on the trial's streets, to which every surface is what the image shows of it.
pub(crate) fn measured_by(model: &SensorModel, sensor: &Sensor) -> Vec<Batch> {
    measured(model, sensor, |image, _| image)
}

/// The same of a sensor that meets surfaces at their true angles.
pub(crate) fn measured_at_true_angles(model: &SensorModel, sensor: &Sensor) -> Vec<Batch> {
    measured(model, sensor, |mut image, cosine| {
        image.surface.known = image.surface.hit.clone();
        image.surface.cos_incidence = cosine;
        image
    })
}

/// `seen` makes of an image, and of the true cosines of incidence, the image that the sensor's effects act on.
fn measured(model: &SensorModel, sensor: &Sensor, seen: impl Fn(Image, Tensor<3>) -> Image) -> Vec<Batch> {
    let device = Device::flex().autodiff();
    let mut dice = ChaCha8Rng::seed_from_u64(7);
    let (mut pairs, cosines): (Vec<Pair>, Vec<Vec<f32>>) = (0..STREETS)
        .map(|seed| {
            let street = street(seed, &StreetConfig::default());
            let pose = Pose::above_ground(&street, 0.0, 0.0, 0.2).expect("ground");
            let cast = cast(&street, sensor, &pose, &Motion::default());
            let measured = RangeImage::empty(sensor.rings().len(), sensor.columns());
            let frame = seed as usize;
            let pair = Pair { frame, scene: frame, simulated: cast.image, keep: None, measured };
            (pair, cast.incidence_rad.iter().map(|a| a.cos().max(0.01)).collect::<Vec<f32>>())
        })
        .unzip();
    let ideal = batches(&pairs.iter().collect::<Vec<_>>(), sensor, &device);
    for ((pair, batch), cosine) in pairs.iter_mut().zip(ideal).zip(cosines) {
        let like = batch.image.surface.range_m.clone();
        let mut uniform = || {
            let numbers: Vec<f32> = (0..like.shape().num_elements()).map(|_| dice.random()).collect();
            Tensor::<3>::from_data(TensorData::new(numbers, like.shape()), &device)
        };
        let noise: [Tensor<3>; NOISE_CHANNELS] = std::array::from_fn(|_| uniform());
        let cosine = Tensor::from_data(TensorData::new(cosine, like.shape()), &device);
        let drawn = model.forward(seen(batch.image, cosine)).draw(noise);
        let reported = uniform().lower(drawn.keep).float();
        let numbers = |x: Tensor<3>| -> Vec<f32> { TensorData::iter::<f32>(&x.into_data()).collect() };
        let range_m = numbers(drawn.range_m * reported);
        let class = vec![0; range_m.len()];
        pair.measured = RangeImage::from_channels(sensor.columns(), range_m, numbers(drawn.reflectance), class);
    }
    batches(&pairs.iter().collect::<Vec<_>>(), sensor, &device)
}
