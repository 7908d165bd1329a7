//! How well a network does on real scans that it did not learn from, beside doing nothing.

use std::fmt::Write as _;

use burn::tensor::Device;
use lidar::RangeImage;
use lidar::metrics::{Forecast, auc, calibration_error, log_loss, mean_absolute_error};
use proto::card::Score;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::data::holes::Pixel;
use crate::data::sample::{CARLA_ATTENUATION, Sample, SimulatedReflectance};
use crate::generator::{Answer, Generator};

/// Seed of the decoys and the jitter when scans are scored.
const SEED: u64 = 20;

/// Scores over a set of scans; each beside the pass-through's, which keeps every ray with its simulated reflectance and range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Scans scored.
    pub scans: usize,
    /// Share of the rays that the sensor reported.
    pub keep_share: f64,
    /// Mean predicted probability over the same rays.
    pub predicted_keep_share: f64,
    /// Logarithmic loss of the keep probability, nats a ray.
    pub keep_log_loss: Pair,
    /// The same for the best constant: every ray kept with the probability [`keep_share`](Self::keep_share).
    pub keep_log_loss_of_constant: f64,
    /// Area under the curve of the keep probability.
    pub keep_auc: Pair,
    /// Expected calibration error of the keep probability, 20 bins.
    pub keep_calibration_error: Pair,
    /// Mean absolute error of the reflectance, over reported rays.
    pub reflectance_mae: Pair,
    /// Mean absolute error of the range in metres, over reported rays.
    pub range_mae_m: Pair,
    /// Control: how well the keep probability tells a decoy from an untouched return, both of which the sensor reported, ring by ring. ½ if the
    /// network does not look at what filling left behind.
    pub decoy_auc: f64,
}

/// A model's score and the pass-through's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// The model's.
    pub model: f64,
    /// The pass-through's.
    pub pass_through: f64,
}

/// Real scans, made to look simulated as in training; their reflectance is CARLA's.
pub fn made_simulated<'a>(images: impl IntoIterator<Item = &'a RangeImage>) -> impl Iterator<Item = Sample> {
    (0..).zip(images).map(|(scan, real)| {
        let mut rng = ChaCha8Rng::seed_from_u64(SEED);
        rng.set_stream(scan);
        Sample::new(real.clone(), true, SimulatedReflectance::Attenuation(CARLA_ATTENUATION), &mut rng)
    })
}

/// Scores a network on real scans that were [made to look simulated](made_simulated).
pub fn evaluate(network: &impl Generator, samples: impl IntoIterator<Item = Sample>, device: &Device) -> Scores {
    scores(samples.into_iter().map(|sample| {
        let answer = Answer::new(network, &sample.simulated, device);
        (sample, answer)
    }))
}

/// Scores answers to real scans that were [made to look simulated](made_simulated).
pub fn scores(answered: impl IntoIterator<Item = (Sample, Answer)>) -> Scores {
    let mut keep = Vec::new();
    let mut decoys = Vec::new();
    let (mut reflectance, mut carla, mut range_m, mut jittered) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut scans = 0;
    for (sample, predicted) in answered {
        scans += 1;
        let real = &sample.real;
        for (ring, row) in sample.pixel.chunks(real.columns()).enumerate() {
            let count = |which: Pixel| row.iter().filter(|p| **p == which).count() as f32;
            // Rings differ in how many decoys they have: an untouched return weighs as much as its ring has decoys for it.
            let untouched = count(Pixel::Decoy) / count(Pixel::Kept).max(1.0);
            for (column, pixel) in row.iter().enumerate() {
                let probability = predicted.keep[ring * real.columns() + column];
                match pixel {
                    Pixel::Decoy => decoys.push(Forecast { probability, outcome: true, weight: 1.0 }),
                    Pixel::Kept => decoys.push(Forecast { probability, outcome: false, weight: untouched }),
                    Pixel::Dropped | Pixel::Empty => {}
                }
            }
        }
        for i in 0..sample.pixel.len() {
            let reported = real.range_m()[i] > 0.0;
            let probability = predicted.keep[i];
            if sample.keep_weight[i] > 0.0 {
                keep.push(Forecast { probability, outcome: reported, weight: sample.keep_weight[i] });
            }
            if sample.pixel[i] == Pixel::Kept {
                let truth = (real.reflectance()[i], real.range_m()[i]);
                reflectance.push((predicted.reflectance[i], truth.0));
                carla.push((sample.simulated.reflectance()[i], truth.0));
                range_m.push((predicted.range_m[i], truth.1));
                jittered.push((sample.simulated.range_m()[i], truth.1));
            }
        }
    }
    let weight = |outcome: Option<bool>| -> f64 {
        keep.iter().filter(|f| outcome.is_none_or(|o| f.outcome == o)).map(|f| f64::from(f.weight)).sum()
    };
    let keep_share = weight(Some(true)) / weight(None);
    let predicted_keep_share =
        keep.iter().map(|f| f64::from(f.weight) * f64::from(f.probability)).sum::<f64>() / weight(None);
    let constant = |probability: f32| keep.iter().map(|f| Forecast { probability, ..*f }).collect::<Vec<_>>();
    let all_kept = constant(1.0);
    Scores {
        scans,
        keep_share,
        predicted_keep_share,
        keep_log_loss: Pair { model: log_loss(&keep), pass_through: log_loss(&all_kept) },
        keep_log_loss_of_constant: log_loss(&constant(keep_share as f32)),
        keep_auc: Pair { model: auc(&keep), pass_through: auc(&all_kept) },
        keep_calibration_error: Pair {
            model: calibration_error(&keep, 20),
            pass_through: calibration_error(&all_kept, 20),
        },
        reflectance_mae: Pair { model: mean_absolute_error(reflectance), pass_through: mean_absolute_error(carla) },
        range_mae_m: Pair { model: mean_absolute_error(range_m), pass_through: mean_absolute_error(jittered) },
        decoy_auc: auc(&decoys),
    }
}

impl Scores {
    /// For the model card.
    pub fn to_card(&self) -> Vec<Score> {
        let score = |metric: &str, unit: &str, pair: Pair| Score {
            metric: metric.into(),
            unit: unit.into(),
            model: pair.model,
            pass_through: pair.pass_through,
            scans: self.scans,
        };
        let constant = Pair { model: self.keep_log_loss.model, pass_through: self.keep_log_loss_of_constant };
        let decoy = Pair { model: self.decoy_auc, pass_through: 0.5 };
        vec![
            score("keep log-loss", "nats/ray", self.keep_log_loss),
            score("keep log-loss (against the best constant)", "nats/ray", constant),
            score("keep AUC", "", self.keep_auc),
            score("keep calibration error", "", self.keep_calibration_error),
            score("reflectance MAE", "", self.reflectance_mae),
            score("range MAE", "m", self.range_mae_m),
            score("decoy AUC (control, ½ is right)", "", decoy),
        ]
    }

    /// As a table for a terminal and for the README.
    pub fn to_table(&self) -> String {
        // Writing into a string cannot fail.
        let mut out = String::from("| metric | unit | pass-through | model |\n|---|---|---|---|\n");
        for s in self.to_card() {
            let _ = writeln!(out, "| {} | {} | {:.4} | {:.4} |", s.metric, s.unit, s.pass_through, s.model);
        }
        let _ = writeln!(
            out,
            "\n{} scans; the sensor reported {:.1} % of the rays, the model expects {:.1} %.",
            self.scans,
            100.0 * self.keep_share,
            100.0 * self.predicted_keep_share
        );
        out
    }
}
