//! CLS2R: Haghighi et al., "Contrastive learning-based framework for sim-to-real mapping of lidar point clouds in autonomous driving
//! systems" (2023).

use anyhow::Result;
use burn::module::Module;
use burn::tensor::{Device, Tensor, s};

use super::told::Answered;
use super::{Approach, Setting, Step, begin, value};
use crate::network::{PatchGan, PatchHeads, Places, Resnet};
use crate::train::{Losses, Parts, Trainee};
use crate::translation::config::TranslationConfig;
use crate::translation::sampler::Chance;
use crate::translation::view::View;

/// Generator, discriminator, and the heads that describe patches.
#[derive(Debug)]
pub struct Cls2r {
    generator: Trainee<Resnet>,
    discriminator: Trainee<PatchGan>,
    heads: Trainee<PatchHeads>,
    setting: Setting,
}

impl Cls2r {
    /// The generator with the weights that it begins with, the others with random ones.
    pub fn new(config: &TranslationConfig, setting: Setting, device: &Device) -> Result<Self> {
        let schedule = &config.schedule;
        let heads = PatchHeads::new(&config.generator.feature_channels(), config.generator.gain, device);
        Ok(Self {
            generator: Trainee::new(begin(config, setting, device)?, schedule),
            discriminator: Trainee::new(config.discriminator.init(device), schedule),
            heads: Trainee::new(heads, schedule),
            setting,
        })
    }
}

impl Approach for Cls2r {
    fn step(&mut self, step: &Step) -> Losses {
        let Setting { reporting, losses, .. } = self.setting;
        let generator = &self.generator.network;
        let shown = step.shown();
        let scans = step.simulated.image.dims()[0];
        let (generated, asked) = generator.forward_with_features(shown.image, &shown.condition);
        let Answered { simulated, judged: answers, real: measured, miss } =
            self.setting.answered(step, &generated, step.drawn(2));
        let asked: Vec<Tensor<4>> = asked.into_iter().map(|features| features.slice(s![0..scans])).collect();
        let (generated, real) = generator.forward_with_features(step.real.image.clone(), &step.real.condition);
        let same = reporting.answer(&generated, step.real.returned.clone(), step.drawn(1));

        let judge = &self.discriminator.network;
        let judged = (judge.forward(measured), judge.forward(answers.clone().detach()));
        let discriminator = losses.game.discriminator(judged.0, judged.1);
        let mut gradients = discriminator.backward();
        self.discriminator.step(step.rate, &mut gradients);

        let judge = self.discriminator.network.clone().no_grad();
        let game = losses.game.generator(judge.forward(answers));
        let mut rng = Chance::Places.of(step.seed, step.number);
        let mut contrast = |answer, view: &View, question| {
            let features = generator.features(answer, &view.condition);
            let places = Places::draw(&features, losses.patches, &mut rng);
            self.heads.network.loss(&features, question, &places)
        };
        let contrast_simulated = contrast(simulated.image, &step.simulated, &asked);
        let contrast_real = contrast(same.image, &step.real, &real);
        let total = game.clone()
            + contrast_simulated.clone() * losses.contrast
            + contrast_real.clone() * losses.contrast_identity;
        let mut values = vec![
            ("discriminator", value(&discriminator)),
            ("game", value(&game)),
            ("contrast", value(&contrast_simulated)),
            ("contrast_identity", value(&contrast_real)),
        ];
        let mut gradients = self.setting.told(total, miss, &mut values).backward();
        self.heads.step(step.rate, &mut gradients);
        self.generator.step(step.rate, &mut gradients);
        values
    }

    fn generator(&self) -> &Resnet {
        &self.generator.network
    }

    fn save(&self, parts: &mut Parts) -> Result<()> {
        self.generator.save("generator", parts)?;
        self.discriminator.save("discriminator", parts)?;
        self.heads.save("heads", parts)
    }

    fn load(&mut self, parts: &Parts) -> Result<()> {
        self.generator.load("generator", parts)?;
        self.discriminator.load("discriminator", parts)?;
        self.heads.load("heads", parts)
    }
}
