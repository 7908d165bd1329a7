//! A discriminator with what it has seen.

use anyhow::{Context, Result};
use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::Rng;

use super::game::Game;
use super::losses::Losses;
use super::pool::Pool;
use super::schedule::Schedule;
use crate::network::{PatchGan, PatchGanConfig};
use crate::train::{Parts, Trainee};

/// A discriminator that may be shown earlier answers again.
#[derive(Debug)]
pub(crate) struct Judge {
    network: Trainee<PatchGan>,
    pool: Pool,
}

impl Judge {
    /// One with random weights that has seen nothing.
    pub(crate) fn new(config: &PatchGanConfig, losses: &Losses, schedule: &Schedule, device: &Device) -> Self {
        Self { network: Trainee::new(config.init(device), schedule), pool: Pool::new(losses.pool) }
    }

    /// Its network as it is, for those whose answers it judges.
    pub(crate) fn frozen(&self) -> PatchGan {
        self.network.network.clone().no_grad()
    }

    /// One step, told what is real and what is an answer; the loss.
    pub(crate) fn learn(
        &mut self,
        game: Game,
        (real, answers): (Tensor<4>, Tensor<4>),
        rate: f64,
        rng: &mut impl Rng,
    ) -> f32 {
        let shown = self.pool.exchange(answers, rng);
        let network = &self.network.network;
        let loss = game.discriminator(network.forward(real), network.forward(shown));
        let value = loss.clone().into_scalar::<f32>();
        self.network.step(rate, &mut loss.backward());
        value
    }

    /// Adds it to the parts of a checkpoint.
    pub(crate) fn save(&self, name: &str, parts: &mut Parts) -> Result<()> {
        parts.put(&format!("{name}-pool"), self.pool.to_bytes());
        self.network.save(name, parts)
    }

    /// Takes it back; an image has so many numbers.
    pub(crate) fn load(&mut self, name: &str, parts: &Parts, image_numbers: usize) -> Result<()> {
        let pool = format!("{name}-pool");
        self.pool = self.pool.with_bytes(parts.get(&pool)?, image_numbers).context(pool)?;
        self.network.load(name, parts)
    }
}
