//! What the training loop asks of whatever learns in it.

use anyhow::Result;
use burn::tensor::Tensor;

use super::parts::Parts;

/// Losses of a step, by name.
pub type Losses = Vec<(&'static str, f32)>;

/// How well a network does on scans that it does not learn from.
#[derive(Clone, Debug)]
pub struct Validation {
    /// What the best network is chosen by; lower is better.
    pub total: f64,
    /// All scores, for the log.
    pub scores: serde_json::Value,
    /// Those that are drawn as curves.
    pub curves: Vec<(String, f64)>,
}

/// A method with its networks, optimisers and data.
pub trait Learner {
    /// One step. It depends on the step's number and on what the steps before it made of the networks, on nothing else.
    fn learn(&mut self, step: usize) -> Losses;
    /// All that the next step depends on.
    fn save(&self, parts: &mut Parts) -> Result<()>;
    /// Takes back what [`save`](Self::save) gave.
    fn load(&mut self, parts: &Parts) -> Result<()>;
    /// Scores the network that would go out.
    fn validate(&self) -> Result<Validation>;
    /// Weights of the network that would go out.
    fn weights(&self) -> Result<Vec<u8>>;
    /// A picture (PNG) of what it makes of a scan that it does not learn from.
    fn picture(&self) -> Result<Vec<u8>>;
    /// What a step is shown, by name.
    fn batch(&self, step: usize) -> Vec<(&'static str, Tensor<4>)>;
}
