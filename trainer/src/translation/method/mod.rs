//! The methods: each one optimiser step on a batch of both domains.

mod cls2r;
mod cycle_gan;
mod distil;
mod gc_gan;
mod paired;
mod told;

use anyhow::{Result, ensure};
use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::answer::{Drawn, Reporting};
use super::config::{Method, TranslationConfig};
use super::losses::Losses;
use super::sampler::{Chance, uniform};
use super::twins::Twins;
use super::view::View;
use crate::network::{Resnet, ResnetConfig};
use crate::train::{Losses as Values, Parts};

pub use cls2r::Cls2r;
pub use cycle_gan::CycleGan;
pub use distil::{Distil, teacher};
pub use gc_gan::GcGan;
pub use paired::Paired;

/// What a step is made of.
#[derive(Clone, Debug)]
pub struct Step {
    /// Simulated scans.
    pub simulated: View,
    /// Real scans, of other places.
    pub real: View,
    /// Real scans made to look simulated, if the config has them learned from.
    pub twins: Option<Twins>,
    /// The run's seed.
    pub seed: u64,
    /// The step's number.
    pub number: usize,
    /// Adam's learning rate.
    pub rate: f64,
}

/// What every method is told.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// The generator as it is trained: for cut-outs, or for whole turns.
    pub generator: ResnetConfig,
    /// How answers lose rays.
    pub reporting: Reporting,
    /// Weights of the losses.
    pub losses: Losses,
    /// Numbers of an answer's image, for what keeps answers.
    pub image_numbers: usize,
}

/// A generator from simulated to real, and whatever else a method needs to teach it.
pub trait Approach {
    /// One optimiser step of every network; the losses by name.
    fn step(&mut self, step: &Step) -> Values;
    /// The generator.
    fn generator(&self) -> &Resnet;
    /// All that the next step depends on.
    fn save(&self, parts: &mut Parts) -> Result<()>;
    /// Takes back what [`save`](Self::save) gave.
    fn load(&mut self, parts: &Parts) -> Result<()>;
}

impl Step {
    /// What draws an answer; each of a step has its own `number`.
    fn drawn(&self, number: u8) -> Drawn {
        let [batch, _, rings, columns] = self.simulated.returned.dims();
        let device = self.simulated.returned.device();
        let draw = |chance: Chance| uniform([batch, rings, columns], &mut chance.of(self.seed, self.number), &device);
        Drawn { ray_drop: draw(Chance::RayDrop(number)), scatter: draw(Chance::Scatter(number)) }
    }
}

/// The method of a config, its generator with the weights that it begins with; `None` for the one that is not shown simulated scans.
pub fn approach(config: &TranslationConfig, setting: Setting, device: &Device) -> Result<Option<Box<dyn Approach>>> {
    Ok(match config.method {
        Method::Cls2r => Some(Box::new(Cls2r::new(config, setting, device)?)),
        Method::CycleGan => Some(Box::new(CycleGan::new(config, setting, device)?)),
        Method::GcGan => Some(Box::new(GcGan::new(config, setting, device)?)),
        Method::Distil => Some(Box::new(Distil::new(config, setting, device)?)),
        Method::Paired => Some(Box::new(Paired::new(config, setting, device)?)),
        Method::UNet => None,
    })
}

/// The generator as training begins: with random weights, or with those of the run that the config names.
fn begin(config: &TranslationConfig, setting: Setting, device: &Device) -> Result<Resnet> {
    let Some(run) = &config.teacher else { return Ok(setting.generator.init(device)) };
    let begun = teacher(config)?;
    // How large weights began is over.
    let (expected, found) = (config.generator, ResnetConfig { gain: config.generator.gain, ..begun.config });
    ensure!(
        found == expected,
        "teacher {}: to begin with its weights takes the same network; it is\n{found:?}\nexpected\n{expected:?}",
        run.display()
    );
    let network = begun.network.generator().clone().with_border(setting.generator.border);
    Ok(network.to_device(&device.clone().inner()).train())
}

/// Mean absolute difference of two images of one size.
fn difference(a: Tensor<4>, b: Tensor<4>) -> Tensor<1> {
    (a - b).abs().mean()
}

/// The value of a loss.
fn value(loss: &Tensor<1>) -> f32 {
    loss.clone().into_scalar::<f32>()
}
