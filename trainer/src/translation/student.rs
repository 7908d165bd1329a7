//! What learns from real scans alone and is applied to simulated ones, in the training loop.

use anyhow::Result;
use burn::tensor::Tensor;

use super::examiner::Examiner;
use super::schedule::Schedule;
use crate::loss::Weights;
use crate::train::checkpoint::network_bytes;
use crate::train::supervised::Student;
use crate::train::{Learner, Losses, Parts, Validation};

/// A U-Net, chosen by how real its answers to simulated scans are.
#[derive(Debug)]
pub(crate) struct Supervised {
    pub(crate) student: Student,
    pub(crate) examiner: Examiner,
    pub(crate) weights: Weights,
    pub(crate) schedule: Schedule,
}

impl Learner for Supervised {
    fn learn(&mut self, step: usize) -> Losses {
        self.student.learn(step, self.weights, self.schedule.rate(step))
    }

    fn save(&self, parts: &mut Parts) -> Result<()> {
        self.student.network.save("network", parts)
    }

    fn load(&mut self, parts: &Parts) -> Result<()> {
        self.student.network.load("network", parts)
    }

    fn validate(&self) -> Result<Validation> {
        Ok(self.examiner.validate(&self.student.network.answering()))
    }

    fn weights(&self) -> Result<Vec<u8>> {
        network_bytes(&self.student.network.answering())
    }

    fn picture(&self) -> Result<Vec<u8>> {
        self.examiner.picture(&self.student.network.answering())
    }

    fn batch(&self, step: usize) -> Vec<(&'static str, Tensor<4>)> {
        self.student.batch(step)
    }
}
