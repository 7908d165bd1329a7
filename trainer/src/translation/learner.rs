//! What plays against a discriminator, in the training loop.

use anyhow::Result;
use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::answer::Reporting;
use super::config::{Schedule, TranslationConfig};
use super::examiner::Examiner;
use super::method::{Adversarial, Setting, Step};
use super::sampler::Sampler;
use super::translator::Translator;
use crate::network::{Border, Resnet};
use crate::train::average::averaged;
use crate::train::checkpoint::{network_bytes, network_from};
use crate::train::{Learner, Losses, Parts, Validation};

/// Name of the averaged generator among the parts of a checkpoint.
const AVERAGE: &str = "average";

/// A method, its data, and the average of its generator.
pub struct Translating {
    method: Box<dyn Adversarial>,
    average: Resnet,
    sampler: Sampler,
    examiner: Examiner,
    reporting: Reporting,
    schedule: Schedule,
    border: Border,
    device: Device,
}

impl Translating {
    /// A learner with random weights.
    pub fn new(
        config: &TranslationConfig,
        (method, setting): (Box<dyn Adversarial>, Setting),
        (sampler, examiner): (Sampler, Examiner),
        device: Device,
    ) -> Self {
        Self {
            average: method.generator().valid(),
            method,
            sampler,
            examiner,
            reporting: setting.reporting,
            schedule: config.schedule,
            border: config.generator.border,
            device,
        }
    }

    fn step(&self, number: usize) -> Step {
        let pair = self.sampler.pair(number, &self.device);
        let coding = self.reporting.coding;
        Step {
            simulated: coding.view(&pair.simulated),
            real: coding.view(&pair.real),
            seed: self.sampler.seed,
            number,
            rate: self.schedule.rate(number),
        }
    }

    fn translator(&self) -> Translator {
        // Clones share the statistics of batch norms; `valid` has its own.
        let average = self.average.valid().to_device(&Device::flex());
        Translator::new(average.with_border(self.border), self.reporting)
    }
}

impl Learner for Translating {
    fn learn(&mut self, number: usize) -> Losses {
        let step = self.step(number);
        let losses = self.method.step(&step);
        self.average = averaged(self.average.clone(), self.method.generator(), number + 1, self.schedule.average);
        losses
    }

    fn save(&self, parts: &mut Parts) -> Result<()> {
        parts.put(AVERAGE, network_bytes(&self.average)?);
        self.method.save(parts)
    }

    fn load(&mut self, parts: &Parts) -> Result<()> {
        self.average = network_from(parts.get(AVERAGE)?, self.average.clone())?;
        self.method.load(parts)
    }

    fn validate(&self) -> Result<Validation> {
        Ok(self.examiner.validate(&self.translator()))
    }

    fn weights(&self) -> Result<Vec<u8>> {
        network_bytes(&self.average)
    }

    fn picture(&self) -> Result<Vec<u8>> {
        self.examiner.picture(&self.translator())
    }

    fn batch(&self, number: usize) -> Vec<(&'static str, Tensor<4>)> {
        let pair = self.sampler.pair(number, &self.device);
        vec![("simulated", pair.simulated), ("real", pair.real)]
    }
}
