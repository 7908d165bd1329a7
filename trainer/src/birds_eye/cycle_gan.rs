//! `CycleGAN` (Zhu et al. 2017) on scans from above: a generator each way, a discriminator each domain.

use anyhow::Result;
use burn::module::Module;
use burn::tensor::{Device, Tensor, s};

use super::config::BirdsEyeConfig;
use super::sampler::Sampler;
use super::training::Examiner;
use super::translator::Translator;
use crate::network::{Generated, Resnet};
use crate::train::average::averaged;
use crate::train::checkpoint::{network_bytes, network_from};
use crate::train::{Learner, Losses as Values, Parts, Trainee, Validation};
use crate::translation::answer::ALPHA;
use crate::translation::judge::Judge;
use crate::translation::losses::Losses;
use crate::translation::sampler::{Chance, uniform};
use crate::translation::schedule::Schedule;

/// Name of the averaged generator among the parts of a checkpoint.
const AVERAGE: &str = "average";

/// The game, in the training loop.
#[derive(Debug)]
pub(super) struct CycleGan {
    to_real: Trainee<Resnet>,
    to_simulated: Trainee<Resnet>,
    real: Judge,
    simulated: Judge,
    average: Resnet,
    sampler: Sampler,
    examiner: Examiner,
    ray_drop: bool,
    losses: Losses,
    schedule: Schedule,
    device: Device,
}

/// Where an image shows returns, `[batch, 1, row, column]`: 1 where its density is more than none.
pub(super) fn occupied(code: &Tensor<4>) -> Tensor<4> {
    code.clone().slice(s![.., 2..3, .., ..]).greater_elem(-1.0).float()
}

/// An answer as it is seen: where cells are lost apart from the image, the drawn ones of those that may show anything.
pub(super) fn answer(generated: &Generated, possible: Option<(Tensor<4>, Tensor<4>)>) -> Tensor<4> {
    match possible {
        None => generated.image.clone(),
        Some((possible, uniform)) => {
            (generated.image.clone() + 1.0) * (generated.reported(uniform, ALPHA) * possible) - 1.0
        }
    }
}

impl CycleGan {
    pub(super) fn new(config: &BirdsEyeConfig, sampler: Sampler, examiner: Examiner) -> Result<Self> {
        let device = config.backend.device()?.autodiff();
        device.seed(config.seed);
        let schedule = config.schedule;
        let generator = || Trainee::new(config.generator.init(&device), &schedule);
        let judge = || Judge::new(&config.discriminator, &config.losses, &schedule, &device);
        let to_real = generator();
        Ok(Self {
            average: to_real.network.valid(),
            to_real,
            to_simulated: generator(),
            real: judge(),
            simulated: judge(),
            sampler,
            examiner,
            ray_drop: config.ray_drop,
            losses: config.losses,
            schedule,
            device,
        })
    }

    fn translator(&self) -> Translator {
        Translator::new(self.average.clone().to_device(&Device::flex()), self.ray_drop)
    }
}

impl Learner for CycleGan {
    fn learn(&mut self, number: usize) -> Values {
        let [x, y] = self.sampler.pair(number, &self.device);
        let [batch, _, side, _] = x.dims();
        let drawn = |drawing: u8| {
            uniform([batch, side, side], &mut Chance::RayDrop(drawing).of(self.sampler.seed, number), &self.device)
        };
        // Labels there are none from above: a generator without a condition is shown the image in its place.
        let back = |image: &Tensor<4>| self.to_simulated.network.forward(image.clone(), image).image;
        let there = |image: &Tensor<4>, possible: Tensor<4>, drawing: u8| {
            let generated = self.to_real.network.forward(image.clone(), image);
            answer(&generated, self.ray_drop.then(|| (possible, drawn(drawing))))
        };
        let as_real = there(&x, occupied(&x), 0);
        let as_simulated = back(&y);
        // What a real sensor lost, a simulation has: the way back may show a return in any cell.
        let any = occupied(&y).ones_like();
        let off = |a: Tensor<4>, b: &Tensor<4>| (a - b.clone()).abs().mean();
        let cycle = off(back(&as_real), &x) + off(there(&as_simulated, any, 1), &y);
        let identity = off(there(&y, occupied(&y), 2), &y) + off(back(&x), &x);
        let Losses { game, cycle: cycle_weight, identity: identity_weight, .. } = self.losses;
        let played = game.generator(self.real.frozen().forward(as_real.clone()))
            + game.generator(self.simulated.frozen().forward(as_simulated.clone()));
        let value = |loss: &Tensor<1>| loss.clone().into_scalar::<f32>();
        let mut values = vec![("game", value(&played)), ("cycle", value(&cycle)), ("identity", value(&identity))];
        let mut gradients = (played + cycle * cycle_weight + identity * identity_weight).backward();
        let rate = self.schedule.rate(number);
        self.to_real.step(rate, &mut gradients);
        self.to_simulated.step(rate, &mut gradients);

        let mut rng = Chance::Pool.of(self.sampler.seed, number);
        values.push(("discriminator", self.real.learn(game, (y, as_real), rate, &mut rng)));
        values.push(("discriminator_simulated", self.simulated.learn(game, (x, as_simulated), rate, &mut rng)));
        self.average = averaged(self.average.clone(), &self.to_real.network, number + 1, self.schedule.average);
        values
    }

    fn save(&self, parts: &mut Parts) -> Result<()> {
        parts.put(AVERAGE, network_bytes(&self.average)?);
        self.to_real.save("generator", parts)?;
        self.to_simulated.save("generator-back", parts)?;
        self.real.save("discriminator", parts)?;
        self.simulated.save("discriminator-back", parts)
    }

    fn load(&mut self, parts: &Parts) -> Result<()> {
        let numbers = lidar::birds_eye::CHANNELS * self.sampler.side * self.sampler.side;
        self.average = network_from(parts.get(AVERAGE)?, self.average.clone())?;
        self.to_real.load("generator", parts)?;
        self.to_simulated.load("generator-back", parts)?;
        self.real.load("discriminator", parts, numbers)?;
        self.simulated.load("discriminator-back", parts, numbers)
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
        let [simulated, real] = self.sampler.pair(number, &self.device);
        vec![("simulated", simulated), ("real", real)]
    }
}
