//! A network and the optimiser that moves it.

use anyhow::{Context, Result};
use burn::grad_clipping::GradientClippingConfig;
use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::{Bytes, Device, Gradients, Tensor};

use super::checkpoint::{network_bytes, network_from};
use super::parts::Parts;
use crate::translation::schedule::Schedule;

/// Adam's decay of the mean square gradient, and what is added to its root: Kingma and Ba (2015), `PyTorch`'s defaults.
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// A network in training.
#[derive(Clone)]
pub struct Trainee<M: Module> {
    /// The network.
    pub network: M,
    optimizer: ModuleOptimizer,
}

impl<M: Module> Trainee<M> {
    /// A network that Adam will move.
    pub fn new(network: M, schedule: &Schedule) -> Self {
        let adam = AdamConfig::new().with_beta_1(schedule.beta_1).with_beta_2(BETA_2).with_epsilon(EPSILON);
        let clipping = GradientClippingConfig::Norm(schedule.clip_norm);
        Self::with_optimizer(network, adam.with_grad_clipping(Some(clipping)).init())
    }

    /// The same with another optimiser.
    pub fn with_optimizer(network: M, optimizer: ModuleOptimizer) -> Self {
        network.visit(&mut Draw);
        Self { network, optimizer }
    }

    /// The network as it answers, on the processor.
    pub fn answering(&self) -> M {
        self.network.valid().to_device(&Device::flex())
    }

    /// One step along the gradients of this network, which are taken out of `gradients`.
    pub fn step(&mut self, rate: f64, gradients: &mut Gradients) {
        let own = GradientsParams::from_module(gradients, &self.network);
        self.network = self.optimizer.step(rate, self.network.clone(), own);
    }

    /// Adds weights and optimiser to the parts of a checkpoint.
    pub fn save(&self, name: &str, parts: &mut Parts) -> Result<()> {
        parts.put(name, network_bytes(&self.network)?);
        parts.put(&optimizer_of(name), self.optimizer.into_bytes()?.to_vec());
        Ok(())
    }

    /// Takes them back.
    pub fn load(&mut self, name: &str, parts: &Parts) -> Result<()> {
        let network = network_from(parts.get(name)?, self.network.clone()).with_context(|| name.to_owned())?;
        let name = optimizer_of(name);
        let bytes = Bytes::from_bytes_vec(parts.get(&name)?.to_vec());
        let optimizer = self.optimizer.clone().from_bytes(bytes).with_context(|| name.clone())?;
        (self.network, self.optimizer) = (network, optimizer);
        Ok(())
    }
}

/// Burn draws random weights when they are first used; here they are drawn at once, so that they depend on no step's order.
struct Draw;

impl ModuleVisitor for Draw {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        drop(param.val());
    }
}

fn optimizer_of(name: &str) -> String {
    format!("{name}-optimizer")
}

impl<M: Module> std::fmt::Debug for Trainee<M> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Trainee").field("network", &self.network).finish_non_exhaustive()
    }
}
