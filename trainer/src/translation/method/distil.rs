//! Distillation: Hinton, Vinyals and Dean, "Distilling the knowledge in a neural network" (2015).

use anyhow::{Context, Result, bail, ensure};
use burn::module::Module;
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor};

use super::told::{Miss, Target};
use super::{Approach, Setting, Step, value};
use crate::loss::{cross_entropy, weighted_mean};
use crate::network::{Generated, Resnet, ResnetConfig};
use crate::train::{Losses, Parts, Trainee};
use crate::translation::config::TranslationConfig;
use crate::translation::training::{Trained, best_network};
use crate::translation::translator::Translator;
use crate::translation::view::View;

/// A generator, and the network of another run that it is to answer like. It plays against nobody, so nothing swings; of real scans it
/// knows what the teacher does.
#[derive(Debug)]
pub struct Distil {
    student: Trainee<Resnet>,
    teacher: Resnet,
    setting: Setting,
}

impl Distil {
    /// A student with random weights, and the best network of the config's teacher.
    pub fn new(config: &TranslationConfig, setting: Setting, device: &Device) -> Result<Self> {
        let student = Trainee::new(setting.generator.init(device), &config.schedule);
        let teacher = teacher(config)?.network.generator().clone().with_border(setting.generator.border);
        Ok(Self { student, teacher: teacher.to_device(&device.clone().inner()), setting })
    }

    /// What the teacher makes of a scan; nobody learns from its gradients.
    fn shown(&self, View { image, condition, .. }: &View) -> Generated {
        let Generated { image, keep_logit, scatter } =
            self.teacher.forward(image.clone().inner(), &condition.clone().inner());
        let scatter = scatter.map(Tensor::from_inner);
        Generated { image: Tensor::from_inner(image), keep_logit: Tensor::from_inner(keep_logit), scatter }
    }
}

impl Approach for Distil {
    fn step(&mut self, step: &Step) -> Losses {
        let losses = self.setting.losses;
        let View { image, condition, returned } = &step.simulated;
        let (shown, said) = (self.shown(&step.simulated), self.student.network.forward(image.clone(), condition));
        let keep = sigmoid(shown.keep_logit.clone());
        let entropy = weighted_mean(cross_entropy(shown.keep_logit, keep.clone()), returned.clone());
        let target = Target { image: shown.image, measured: returned.clone(), keep, keep_weight: returned.clone() };
        let miss = Miss::new(said, target);
        // The divergence of one mask from the other: 0 where they agree, which their cross entropy is not.
        let miss = Miss { keep: miss.keep - entropy, ..miss };
        let values =
            vec![("keep", value(&miss.keep)), ("range", value(&miss.range)), ("reflectance", value(&miss.reflectance))];
        let mut gradients = miss.total(&losses).backward();
        self.student.step(step.rate, &mut gradients);
        values
    }

    fn generator(&self) -> &Resnet {
        &self.student.network
    }

    fn save(&self, parts: &mut Parts) -> Result<()> {
        self.student.save("generator", parts)
    }

    fn load(&mut self, parts: &Parts) -> Result<()> {
        self.student.load("generator", parts)
    }
}

/// The best network of a run that is learned from.
#[derive(Debug)]
pub struct Teacher {
    /// As it answers.
    pub network: Translator,
    /// What it is built by.
    pub config: ResnetConfig,
}

/// The best network of the run that a config names as teacher.
///
/// A run that saw scans otherwise, or other real scans, is refused: what the student's card says would not be true.
pub fn teacher(config: &TranslationConfig) -> Result<Teacher> {
    let run = config.teacher.as_deref().context("method distil: name the run to learn from, `teacher`")?;
    let load = || -> Result<Teacher> {
        let taught = TranslationConfig::read(&run.join("config.toml"))?;
        let seen = |config: &TranslationConfig| -> Result<String> {
            let TranslationConfig { sensor, columns, licence, own_vehicle, attenuation_per_m, real, .. } = config;
            let (reporting, real) = (config.reporting()?, toml::to_string(real)?);
            Ok(format!(
                "{sensor:?} {columns:?} {reporting:?}, own vehicle: {own_vehicle}, attenuation: {attenuation_per_m:?}, \
                 licence {licence}\n{real}"
            ))
        };
        let (expected, found) = (seen(config)?, seen(&taught)?);
        ensure!(found == expected, "it learned from\n{found}\nexpected\n{expected}");
        match best_network(&taught, run)? {
            Trained::Translator(network) => Ok(Teacher { network: *network, config: taught.generator }),
            Trained::UNet(_) => {
                bail!("a U-Net gives no codes to learn; expected a network that is shown simulated scans")
            }
        }
    };
    load().with_context(|| format!("teacher {}", run.display()))
}
