//! `GcGAN`: Fu et al., "Geometry-consistent generative adversarial networks for one-sided unsupervised domain mapping" (2019), with
//! left and right exchanged as the geometry.

use anyhow::Result;
use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::told::Answered;
use super::{Approach, Setting, Step, begin, difference, value};
use crate::network::{PatchGan, Resnet};
use crate::train::{Losses, Parts, Trainee};
use crate::translation::answer::Drawn;
use crate::translation::config::TranslationConfig;
use crate::translation::view::View;

/// One generator, a discriminator of scans and one of mirrored scans.
#[derive(Debug)]
pub struct GcGan {
    generator: Trainee<Resnet>,
    discriminator: Trainee<PatchGan>,
    discriminator_mirrored: Trainee<PatchGan>,
    setting: Setting,
}

impl GcGan {
    /// The generator with the weights that it begins with, the others with random ones.
    pub fn new(config: &TranslationConfig, setting: Setting, device: &Device) -> Result<Self> {
        let schedule = &config.schedule;
        let judge = || Trainee::new(config.discriminator.init(device), schedule);
        Ok(Self {
            generator: Trainee::new(begin(config, setting, device)?, schedule),
            discriminator: judge(),
            discriminator_mirrored: judge(),
            setting,
        })
    }
}

/// Left and right exchanged.
fn mirror(x: Tensor<4>) -> Tensor<4> {
    x.flip([3])
}

impl View {
    /// Left and right exchanged in all that a scan shows, its labels too.
    fn mirrored(&self) -> Self {
        let Self { image, condition, returned } = self.clone();
        Self { image: mirror(image), condition: mirror(condition), returned: mirror(returned) }
    }
}

impl Drawn {
    /// Left and right exchanged.
    fn mirrored(self) -> Self {
        Self { ray_drop: mirror(self.ray_drop), scatter: mirror(self.scatter) }
    }
}

impl Approach for GcGan {
    fn step(&mut self, step: &Step) -> Losses {
        let Setting { reporting, losses, .. } = self.setting;
        let generator = &self.generator.network;
        let answer = |view: &View, drawn: Drawn| {
            let generated = generator.forward(view.image.clone(), &view.condition);
            reporting.answer(&generated, view.returned.clone(), drawn).image
        };
        let (x, y) = (&step.simulated, &step.real);
        let (x_mirrored, y_mirrored) = (x.mirrored(), y.mirrored());
        let shown = step.shown();
        let generated = generator.forward(shown.image, &shown.condition);
        let Answered { simulated, judged, real, miss } = self.setting.answered(step, &generated, step.drawn(2));
        // The same chance decides which rays are lost, or two like answers would differ by it.
        let of_y = step.drawn(1);
        let answers_mirrored = answer(&x_mirrored, step.drawn(0).mirrored());
        let identity = difference(answer(y, of_y.clone()), y.image.clone())
            + difference(answer(&y_mirrored, of_y.mirrored()), y_mirrored.image.clone());
        let geometry = difference(mirror(simulated.image), answers_mirrored.clone());

        let frozen = |judge: &Trainee<PatchGan>| judge.network.clone().no_grad();
        let game = losses.game.generator(frozen(&self.discriminator).forward(judged.clone()))
            + losses.game.generator(frozen(&self.discriminator_mirrored).forward(answers_mirrored.clone()));
        // The authors count the difference twice: as it is, and mirrored.
        let total = game.clone() + geometry.clone() * (2.0 * losses.geometry) + identity.clone() * losses.identity;
        let mut values = vec![("game", value(&game)), ("geometry", value(&geometry)), ("identity", value(&identity))];
        let total = self.setting.told(total, miss, &mut values);
        self.generator.step(step.rate, &mut total.backward());

        for (name, judge, scans, answers) in [
            ("discriminator", &mut self.discriminator, real, judged),
            ("discriminator_mirrored", &mut self.discriminator_mirrored, y_mirrored.image, answers_mirrored),
        ] {
            let of_scans = judge.network.forward(scans);
            let loss = losses.game.discriminator(of_scans, judge.network.forward(answers.detach()));
            values.push((name, value(&loss)));
            judge.step(step.rate, &mut loss.backward());
        }
        values
    }

    fn generator(&self) -> &Resnet {
        &self.generator.network
    }

    fn save(&self, parts: &mut Parts) -> Result<()> {
        self.generator.save("generator", parts)?;
        self.discriminator.save("discriminator", parts)?;
        self.discriminator_mirrored.save("discriminator-mirrored", parts)
    }

    fn load(&mut self, parts: &Parts) -> Result<()> {
        self.generator.load("generator", parts)?;
        self.discriminator.load("discriminator", parts)?;
        self.discriminator_mirrored.load("discriminator-mirrored", parts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Distribution;

    #[test]
    fn what_is_mirrored_is_mirrored_with_its_labels() {
        let device = Device::flex();
        device.seed(1);
        let random = |channels| Tensor::<4>::random([2, channels, 3, 8], Distribution::Uniform(-1.0, 1.0), &device);
        let view = View { image: random(2), condition: random(1), returned: random(1) };
        let mirrored = view.mirrored();
        let column = |x: &Tensor<4>, i: usize| x.clone().slice(burn::tensor::s![.., .., .., i..i + 1]);
        let same = |a: Tensor<4>, b: Tensor<4>| (a - b).abs().max().into_scalar::<f32>() == 0.0;
        for i in 0..8 {
            for (there, here) in [
                (&mirrored.image, &view.image),
                (&mirrored.condition, &view.condition),
                (&mirrored.returned, &view.returned),
            ] {
                assert!(same(column(there, i), column(here, 7 - i)));
            }
        }
    }
}
