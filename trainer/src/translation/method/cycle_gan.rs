//! `CycleGAN`: Zhu et al., "Unpaired image-to-image translation using cycle-consistent adversarial networks" (2017); with ray drop, the
//! paper's "baseline + RS".

use anyhow::Result;
use burn::tensor::{Device, Tensor};

use super::told::Answered;
use super::{Approach, Setting, Step, begin, difference, value};
use crate::network::Resnet;
use crate::train::{Losses, Parts, Trainee};
use crate::translation::answer::Answer;
use crate::translation::config::TranslationConfig;
use crate::translation::judge::Judge;
use crate::translation::sampler::Chance;

/// A generator each way, a discriminator each domain.
#[derive(Debug)]
pub struct CycleGan {
    to_real: Trainee<Resnet>,
    to_simulated: Trainee<Resnet>,
    real: Judge,
    simulated: Judge,
    setting: Setting,
}

impl CycleGan {
    /// The generator to real with the weights that it begins with, the others with random ones.
    pub fn new(config: &TranslationConfig, setting: Setting, device: &Device) -> Result<Self> {
        let schedule = &config.schedule;
        let to_real = Trainee::new(begin(config, setting, device)?, schedule);
        let to_simulated = Trainee::new(setting.generator.init(device), schedule);
        let judge = || Judge::new(&config.discriminator, &config.losses, schedule, device);
        Ok(Self { to_real, to_simulated, real: judge(), simulated: judge(), setting })
    }
}

impl Approach for CycleGan {
    fn step(&mut self, step: &Step) -> Losses {
        let Setting { reporting, losses, .. } = self.setting;
        let (x, y) = (&step.simulated, &step.real);
        let answer = |network: &Resnet, image: &Tensor<4>, condition, possible: &Tensor<4>, number| {
            reporting.answer(&network.forward(image.clone(), condition), possible.clone(), step.drawn(number))
        };
        let (there, back) = (&self.to_real.network, &self.to_simulated.network);
        // What a real sensor lost, a simulation has: the way back may show a return on any ray.
        let any = x.returned.ones_like();
        let shown = step.shown();
        let generated = there.forward(shown.image, &shown.condition);
        let Answered { simulated: as_real, judged, real, miss } =
            self.setting.answered(step, &generated, step.drawn(6));
        let as_simulated = answer(back, &y.image, &y.condition, &any, 1);
        let x_again = answer(back, &as_real.image, &x.condition, &any, 2);
        let y_again = answer(there, &as_simulated.image, &y.condition, &as_simulated.reported, 3);
        let y_same = answer(there, &y.image, &y.condition, &y.returned, 4);
        let x_same = answer(back, &x.image, &x.condition, &any, 5);

        let off = |answer: Answer, image: &Tensor<4>| difference(answer.image, image.clone());
        let cycle = off(x_again, &x.image) + off(y_again, &y.image);
        let identity = off(x_same, &x.image) + off(y_same, &y.image);
        let game = losses.game.generator(self.real.frozen().forward(judged.clone()))
            + losses.game.generator(self.simulated.frozen().forward(as_simulated.image.clone()));
        let total = game.clone() + cycle.clone() * losses.cycle + identity.clone() * losses.identity;
        let mut values = vec![("game", value(&game)), ("cycle", value(&cycle)), ("identity", value(&identity))];
        let mut gradients = self.setting.told(total, miss, &mut values).backward();
        self.to_real.step(step.rate, &mut gradients);
        self.to_simulated.step(step.rate, &mut gradients);

        let mut rng = Chance::Pool.of(step.seed, step.number);
        for (name, judge, scans, answers) in [
            ("discriminator", &mut self.real, real, judged),
            ("discriminator_simulated", &mut self.simulated, x.image.clone(), as_simulated.image),
        ] {
            values.push((name, judge.learn(losses.game, (scans, answers), step.rate, &mut rng)));
        }
        values
    }

    fn generator(&self) -> &Resnet {
        &self.to_real.network
    }

    fn save(&self, parts: &mut Parts) -> Result<()> {
        self.to_real.save("generator", parts)?;
        self.to_simulated.save("generator-back", parts)?;
        self.real.save("discriminator", parts)?;
        self.simulated.save("discriminator-back", parts)
    }

    fn load(&mut self, parts: &Parts) -> Result<()> {
        self.to_real.load("generator", parts)?;
        self.to_simulated.load("generator-back", parts)?;
        self.real.load("discriminator", parts, self.setting.image_numbers)?;
        self.simulated.load("discriminator-back", parts, self.setting.image_numbers)
    }
}
