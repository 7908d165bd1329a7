//! What a translation's training minimises.

use serde::{Deserialize, Serialize};

use super::game::Game;

/// Whose answers the discriminator of real scans judges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Judged {
    /// Those to simulated scans.
    #[default]
    Simulated,
    /// Those to twins as well, beside what was measured there: Isola et al., "Image-to-image translation with conditional adversarial
    /// networks" (2017), has pairs judged so. There, places are no way to tell answers from real scans; only the sensor is.
    WithTwins,
}

/// Weights of the losses; each method takes those that it knows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Losses {
    /// The adversarial loss, of weight 1.
    pub game: Game,
    /// CLS2R: patches of the answer against those of the simulated scan; the paper's λ for X.
    pub contrast: f64,
    /// CLS2R: patches of the answer to a real scan against those of the scan itself; the paper's λ for Y.
    pub contrast_identity: f64,
    /// CLS2R: patches a layer.
    pub patches: usize,
    /// `CycleGAN`: mean absolute difference between a scan and what the way there and back makes of it.
    pub cycle: f64,
    /// `GcGAN`: mean absolute difference between the mirrored answer and the answer to the mirrored scan; the authors' 10 · 2.
    pub geometry: f64,
    /// `CycleGAN`, `GcGAN`: mean absolute difference between a scan of the domain that is aimed at and what becomes of it; 10 · 0.5 of
    /// `CycleGAN`'s authors (`GcGAN`'s take 10 · 0.3).
    pub identity: f64,
    /// `CycleGAN`: earlier answers that a discriminator may be shown again.
    pub pool: usize,
    /// Games, beyond the papers: real scans that were made to look simulated should become themselves again. Nothing else that is learned
    /// from says which ray is lost.
    pub twins: f64,
    /// Games with twins: whether these are judged as well.
    pub judged: Judged,
    /// Beside the cross entropy of the keep mask, the mean absolute error of the reflectance (`unet`), of its code (`distil`, `twins`).
    pub reflectance: f32,
    /// The same of ln(r + 1) (`unet`), of the range code (`distil`, `twins`).
    pub range: f32,
}

impl Default for Losses {
    fn default() -> Self {
        Self {
            game: Game::default(),
            contrast: 1.0,
            contrast_identity: 2.0,
            patches: 256,
            cycle: 10.0,
            geometry: 20.0,
            identity: 5.0,
            pool: 50,
            twins: 0.0,
            judged: Judged::default(),
            reflectance: 4.0,
            range: 2.0,
        }
    }
}
