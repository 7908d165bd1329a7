//! What a model has to do before it is served: answer an empty and a full scan with finite numbers, and the same ones again.

use lidar::ray_drop::uniform;
use lidar::{RangeImage, Sensor};
use proto::card::Card;
use thiserror::Error;

use crate::generator::{Chance, Generator, InferenceError, OUTPUTS};
use crate::model::{Model, SessionError};

/// A model that does not do it.
#[derive(Debug, Error)]
pub enum TrialError {
    /// It does not load.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// It does not run, or an output has another shape than the card promises.
    #[error("does not run on {scan}: {source}")]
    Run {
        /// The scan.
        scan: &'static str,
        /// What happens.
        source: InferenceError,
    },
    /// It gives something that is no number.
    #[error("output `{output}` is not finite for {count} of {rays} rays of {scan}")]
    NotFinite {
        /// The scan.
        scan: &'static str,
        /// The output.
        output: &'static str,
        /// Rays with NaN or infinity.
        count: usize,
        /// Rays.
        rays: usize,
    },
    /// It answers one question in two ways.
    #[error("output `{output}` is another one the second time, for {scan}")]
    Differs {
        /// The scan.
        scan: &'static str,
        /// The output.
        output: &'static str,
    },
}

/// Loads a model and tries it on made-up scans, on one thread.
pub fn try_out(model: &Model) -> Result<(), TrialError> {
    let card = &model.card;
    let mut generator = Generator::new(model, 1)?;
    let scans = [("an empty scan", empty(&card.sensor)), ("a full scan", full(card))];
    for (scan, image) in scans {
        generator.fill(&image, Chance::default());
        let first = outputs(&mut generator, scan)?;
        let second = outputs(&mut generator, scan)?;
        for (output, (first, second)) in OUTPUTS.into_iter().zip(first.iter().zip(&second)) {
            // What a model says of a ray without a return counts only if it may add some.
            let counts = |i: usize| card.adds_returns || image.range_m()[i] > 0.0;
            let count = (0..first.len()).filter(|i| counts(*i) && !first[*i].is_finite()).count();
            if count > 0 {
                return Err(TrialError::NotFinite { scan, output, count, rays: first.len() });
            }
            if first.iter().zip(second).any(|(first, second)| first.to_bits() != second.to_bits()) {
                return Err(TrialError::Differs { scan, output });
            }
        }
    }
    Ok(())
}

/// One run, in the order of [`OUTPUTS`].
fn outputs(generator: &mut Generator, scan: &'static str) -> Result<Vec<Vec<f32>>, TrialError> {
    let run = |source| TrialError::Run { scan, source };
    let outputs = generator.run().map_err(run)?;
    OUTPUTS.into_iter().map(|name| outputs.of(name).map(<[f32]>::to_vec)).collect::<Result<_, _>>().map_err(run)
}

fn empty(sensor: &Sensor) -> RangeImage {
    RangeImage::empty(sensor.rings().len(), sensor.columns())
}

/// A return on every ray: ranges, reflectances and classes of all that the card allows, the same for the same card.
fn full(card: &Card) -> RangeImage {
    let sensor = &card.sensor;
    let draw = |channel| {
        let mut numbers = vec![0.0; sensor.pixels()];
        uniform(0, channel, sensor.columns(), &mut numbers);
        numbers
    };
    let (near_m, far_m) = sensor.range_limits_m();
    // Channels from 1 on are the model's noise; these are far from those.
    let range_m = draw(u32::MAX).into_iter().map(|u| near_m + u * (far_m - near_m)).collect();
    let class = draw(u32::MAX - 1).into_iter().map(|u| (u * card.classes.len().min(256) as f32) as u8).collect();
    RangeImage::from_channels(sensor.columns(), range_m, draw(u32::MAX - 2), class)
}
