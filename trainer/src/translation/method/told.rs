//! What games are told besides: real scans made to look simulated, which should become themselves again.

use burn::tensor::{Tensor, s};

use super::{Setting, Step, value};
use crate::loss::{cross_entropy, weighted_mean};
use crate::network::Generated;
use crate::network::scatter::ranked_probability_score;
use crate::train::Losses as Values;
use crate::translation::answer::{Answer, Drawn};
use crate::translation::losses::{Judged, Losses};
use crate::translation::twins::Twins;
use crate::translation::view::View;

/// What a generator should have said of scans, pixel by pixel, each `[batch, …, ring, column]`.
pub(super) struct Target {
    /// Range code and reflectance.
    pub(super) image: Tensor<4>,
    /// 1 where these count.
    pub(super) measured: Tensor<4>,
    /// Probability that the ray is reported.
    pub(super) keep: Tensor<4>,
    /// What each ray of these counts.
    pub(super) keep_weight: Tensor<4>,
}

/// How far a generator is from what it should have said; each a scalar.
pub(super) struct Miss {
    /// Cross entropy of the mask, nats a ray.
    pub(super) keep: Tensor<1>,
    /// Mean absolute error of the range code.
    pub(super) range: Tensor<1>,
    /// The same of the reflectance's; where a network says how far it scatters, the continuous ranked probability score of that.
    pub(super) reflectance: Tensor<1>,
}

impl Miss {
    pub(super) fn new(said: Generated, target: Target) -> Self {
        let keep = weighted_mean(cross_entropy(said.keep_logit, target.keep), target.keep_weight);
        let error = (said.image - target.image).abs();
        let channel = |i: usize| error.clone().slice(s![.., i..i + 1, .., ..]);
        let reflectance = match &said.scatter {
            Some(scatter) => ranked_probability_score(channel(1), scatter),
            None => channel(1),
        };
        let mean = |error| weighted_mean(error, target.measured.clone());
        Self { keep, range: mean(channel(0)), reflectance: mean(reflectance) }
    }

    /// How far what a generator said of twins is from what was measured.
    pub(super) fn of_twins(said: Generated, Twins { shown, measured, keep_weight }: &Twins) -> Self {
        let target = Target {
            image: measured.image.clone(),
            measured: measured.returned.clone() * shown.returned.clone(),
            keep: measured.returned.clone(),
            keep_weight: keep_weight.clone(),
        };
        Self::new(said, target)
    }

    /// All of it, each as heavy as the config says.
    pub(super) fn total(self, losses: &Losses) -> Tensor<1> {
        self.keep + self.range * losses.range + self.reflectance * losses.reflectance
    }
}

/// What a generator answered to a step's simulated scans and to its twins.
pub(super) struct Answered {
    /// To the simulated scans.
    pub(super) simulated: Answer,
    /// The answers that the discriminator of real scans judges, `[batch, 2, ring, column]`.
    pub(super) judged: Tensor<4>,
    /// The real scans that it is shown beside them.
    pub(super) real: Tensor<4>,
    /// How far what was said of twins is from what was measured; `None` without twins.
    pub(super) miss: Option<Miss>,
}

impl Step {
    /// What a generator is shown: simulated scans, and twins in one batch with them. Batch norms see both alike, with whose statistics the
    /// network goes out.
    pub(super) fn shown(&self) -> View {
        self.twins.as_ref().map_or(self.simulated.clone(), |twins| self.simulated.beside(&twins.shown))
    }
}

impl Setting {
    /// The answers to what a step [showed](Step::shown), those to twins drawn by a chance of their own.
    pub(super) fn answered(&self, step: &Step, generated: &Generated, of_twins: Drawn) -> Answered {
        let Self { reporting, losses, .. } = self;
        let scans = step.simulated.image.dims()[0];
        let simulated = reporting.answer(&generated.scans(0..scans), step.simulated.returned.clone(), step.drawn(0));
        let (mut judged, mut real) = (simulated.image.clone(), step.real.image.clone());
        let miss = step.twins.as_ref().map(|twins| {
            let said = generated.scans(scans..2 * scans);
            if losses.judged == Judged::WithTwins {
                let answer = reporting.answer(&said, twins.shown.returned.clone(), of_twins);
                judged = Tensor::cat(vec![judged.clone(), answer.image], 0);
                real = Tensor::cat(vec![real.clone(), twins.measured.image.clone()], 0);
            }
            Miss::of_twins(said, twins)
        });
        Answered { simulated, judged, real, miss }
    }

    /// A game's loss, and what twins add to it where there are any, which is named among the step's values.
    pub(super) fn told(&self, game: Tensor<1>, miss: Option<Miss>, values: &mut Values) -> Tensor<1> {
        let Some(miss) = miss else { return game };
        let twins = miss.total(&self.losses);
        values.push(("twins", value(&twins)));
        game + twins * self.losses.twins
    }
}
