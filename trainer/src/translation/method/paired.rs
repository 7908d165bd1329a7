//! Real scans made to look simulated, which should become themselves again; nothing else.

use anyhow::Result;
use burn::tensor::Device;

use super::told::Miss;
use super::{Approach, Setting, Step, begin, value};
use crate::network::Resnet;
use crate::train::{Losses, Parts, Trainee};
use crate::translation::config::TranslationConfig;

/// A generator that plays against nobody. It learns which rays are lost, which no game tells, and what real scans look like in its own
/// guess of a simulator alone: a network for others to begin with.
#[derive(Debug)]
pub struct Paired {
    generator: Trainee<Resnet>,
    setting: Setting,
}

impl Paired {
    /// With the weights that it begins with.
    pub fn new(config: &TranslationConfig, setting: Setting, device: &Device) -> Result<Self> {
        Ok(Self { generator: Trainee::new(begin(config, setting, device)?, &config.schedule), setting })
    }
}

impl Approach for Paired {
    fn step(&mut self, step: &Step) -> Losses {
        // A config of this method always has them.
        let Some(twins) = &step.twins else { return vec![] };
        let losses = self.setting.losses;
        // Beside simulated scans, of which nothing is asked: batch norms see what the network goes out with, and labels, which no real scan has.
        let shown = step.shown();
        let scans = step.simulated.image.dims()[0];
        let said = self.generator.network.forward(shown.image, &shown.condition).scans(scans..2 * scans);
        let miss = Miss::of_twins(said, twins);
        let values =
            vec![("keep", value(&miss.keep)), ("range", value(&miss.range)), ("reflectance", value(&miss.reflectance))];
        let mut gradients = miss.total(&losses).backward();
        self.generator.step(step.rate, &mut gradients);
        values
    }

    fn generator(&self) -> &Resnet {
        &self.generator.network
    }

    fn save(&self, parts: &mut Parts) -> Result<()> {
        self.generator.save("generator", parts)
    }

    fn load(&mut self, parts: &Parts) -> Result<()> {
        self.generator.load("generator", parts)
    }
}
