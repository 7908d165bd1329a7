//! What plays against a discriminator, in the training loop.

use anyhow::Result;
use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::answer::Reporting;
use super::config::TranslationConfig;
use super::examiner::Examiner;
use super::method::{Approach, Setting, Step};
use super::sampler::Sampler;
use super::schedule::Schedule;
use super::translator::Translator;
use super::view::View;
use crate::network::{NormKind, Resnet, ResnetConfig};
use crate::train::average::averaged;
use crate::train::checkpoint::{network_bytes, network_from};
use crate::train::{Learner, Losses, Parts, Validation};

/// Name of the averaged generator among the parts of a checkpoint.
const AVERAGE: &str = "average";

/// Batches that a batch norm's statistics are estimated by: Burn's running ones keep 0.1 % of what they were before.
const SETTLING: usize = 64;

/// A method, its data, and the average of its generator.
pub struct Translating {
    method: Box<dyn Approach>,
    average: Resnet,
    sampler: Sampler,
    examiner: Examiner,
    reporting: Reporting,
    schedule: Schedule,
    generator: ResnetConfig,
    device: Device,
}

impl Translating {
    /// A learner with random weights.
    pub fn new(
        config: &TranslationConfig,
        (method, setting): (Box<dyn Approach>, Setting),
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
            generator: config.generator,
            device,
        }
    }

    fn step(&self, number: usize) -> Step {
        let pair = self.sampler.pair(number, &self.device);
        let coding = self.reporting.coding;
        Step {
            simulated: coding.view(&pair.simulated),
            real: coding.view(&pair.real),
            twins: self.sampler.twins(number, coding, &self.device),
            seed: self.sampler.seed,
            number,
            rate: self.schedule.rate(number),
        }
    }

    /// The averaged generator as it goes out.
    fn settled(&self) -> Resnet {
        if self.generator.norm != NormKind::Batch {
            return self.average.clone();
        }
        // What its norms saw at once in training, without real scans and answers.
        let shown = |number| {
            let Step { simulated, twins, .. } = self.step(number);
            twins.map_or(simulated.clone(), |twins| simulated.beside(&twins.shown))
        };
        settled(&self.average, (0..SETTLING).map(shown))
    }

    fn translator(&self) -> Translator {
        // Clones share the statistics of batch norms, and move them along; `valid` has its own.
        let generator = self.settled().valid().to_device(&Device::flex());
        Translator::new(generator.with_border(self.generator.border), self.reporting)
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
        network_bytes(&self.settled())
    }

    fn picture(&self) -> Result<Vec<u8>> {
        self.examiner.picture(&self.translator())
    }

    fn batch(&self, number: usize) -> Vec<(&'static str, Tensor<4>)> {
        let pair = self.sampler.pair(number, &self.device);
        vec![("simulated", pair.simulated), ("real", pair.real)]
    }
}

/// The network, its batch norms with the statistics of these scans alone, as in stochastic weight averaging (Izmailov et al., 2018): in
/// training they have seen real scans and answers as well, which are none of what the network will be shown.
fn settled(network: &Resnet, scans: impl Iterator<Item = View>) -> Resnet {
    // Clones share the statistics of batch norms; `valid` has its own.
    let network = network.valid().train().no_grad();
    for View { image, condition, .. } in scans {
        // Burn lets go of what a forward pass remembered at the next way back, even if nobody wants gradients: 55 MB a turn.
        let way_back = Tensor::<1>::zeros([1], &image.device()).require_grad();
        network.forward(image, &condition);
        way_back.backward();
    }
    network.valid()
}

#[cfg(test)]
mod tests {
    use burn::tensor::Distribution;

    use super::*;

    /// Scans whose codes scatter by ½ about a mean.
    fn scans(mean: f64, device: &Device) -> View {
        let draw = |channels| Tensor::random([4, channels, 16, 32], Distribution::Normal(mean, 0.5), device);
        View { image: draw(2), condition: draw(1), returned: Tensor::ones([4, 1, 16, 32], device) }
    }

    /// The mean difference of two networks' answers.
    fn difference(a: &Tensor<4>, b: &Tensor<4>) -> f32 {
        (a.clone() - b.clone()).abs().mean().into_scalar()
    }

    #[test]
    fn batch_norms_of_what_goes_out_know_simulated_scans_alone() {
        let device = Device::flex().autodiff();
        device.seed(7);
        let config = ResnetConfig { width: 8, blocks: 1, norm: NormKind::Batch, ..ResnetConfig::default() };
        let fresh = config.init(&device);
        let answer = |network: &Resnet, view: &View| network.forward(view.image.clone(), &view.condition).image;
        // Clones share the statistics of batch norms; `valid` has its own.
        let training = fresh.valid().train();
        // Random weights make features so small that the statistics of no scan at all outweigh them for a while.
        for number in 0..4 * SETTLING {
            answer(&training, &scans(if number % 2 == 0 { -0.5 } else { 1.0 }, &device));
        }
        let average = training.valid();
        let simulated: Vec<View> = (0..SETTLING).map(|_| scans(-0.5, &device)).collect();
        let pure = fresh.valid().train();
        for number in 0..4 * SETTLING {
            answer(&pure, &simulated[number % SETTLING]);
        }

        let View { image, condition, returned } = scans(-0.5, &device);
        let shown = View { image: image.inner(), condition: condition.inner(), returned: returned.inner() };
        let (before, expected) = (answer(&average, &shown), answer(&pure.valid(), &shown));
        let settled = settled(&average, simulated.into_iter());
        let errors = [&settled, &average].map(|network| difference(&answer(network, &shown), &expected));
        assert!(errors[0] < 0.05 * errors[1], "{errors:?}");
        assert_eq!(difference(&answer(&average, &shown), &before), 0.0, "the average itself stays as it is");
    }
}
