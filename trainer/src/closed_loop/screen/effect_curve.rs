//! What one effect explains, along one covariate: the residual without it, the effect itself, and the residual with it.

use serde::Serialize;

use super::bins::Column;
use super::residual::{LARGEST_M, Residuals};
use super::{CHANNELS, Dependence, Screening, covariates};
use crate::closed_loop::data::Batch;
use crate::closed_loop::model::SensorModel;
use crate::closed_loop::outcome::Interval;
use crate::closed_loop::predicted::Predicted;
use crate::closed_loop::resample::Bootstrap;
use crate::effects::{Channel, Covariate};

/// The curve of an effect.
#[derive(Clone, Debug, Serialize)]
pub struct EffectCurve {
    /// Name of the effect.
    pub effect: String,
    /// Channel whose residual is shown; moved rays show in the range.
    pub channel: Channel,
    /// What it is shown against.
    pub covariate: Covariate,
    /// The curve, piece by piece.
    pub pieces: Vec<Piece>,
}

/// A piece of an effect's curve; means in [`unit`](super::unit)s of the channel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Piece {
    /// Lower edge, in the covariate's unit.
    pub from: f64,
    /// Upper edge.
    pub to: f64,
    /// Mean residual of the model without the effect.
    pub without: Interval,
    /// By how much the effect changes what the model says.
    pub effect: f64,
    /// Mean residual of the model with it.
    pub with: Interval,
}

/// The curve of an effect of a model, on these batches; along the first of its own covariates that the screening knows, or else along the
/// one on which the residual before depended most. `None` where there is none.
pub fn effect_curve(
    model: &SensorModel,
    effect: &str,
    before: &Screening,
    batches: &[&Batch],
    seed: u64,
) -> Option<EffectCurve> {
    let about = model.effects().iter().find(|t| t.name() == effect)?.effect.about();
    let channel = if about.channel == Channel::Geometry { Channel::Range } else { about.channel };
    let c = CHANNELS.iter().position(|of| *of == channel)?;
    let without_it = model.without(effect);
    let mut residuals = [Residuals::default(), Residuals::default()];
    let (mut values, mut changes): (Vec<covariates::Values>, Vec<f64>) = (vec![], vec![]);
    let mut frames: Vec<usize> = vec![];
    for batch in batches {
        let image = model.forward(batch.image.clone());
        let (with, without) = (Predicted::of(&image, batch), Predicted::new(&without_it, batch));
        residuals[0].add(&without);
        residuals[1].add(&with);
        changes.extend((0..with.hit.len()).map(|i| change(channel, &without, &with, i)));
        frames.extend(batch.frames.iter().map(|_| batch.scene));
        let of = covariates::of(&image, batch.observed.range_m.dims());
        if values.is_empty() {
            values = of;
        } else {
            values.iter_mut().zip(of).for_each(|(all, of)| all.values.extend(of.values));
        }
    }
    let strongest = |d: &&Dependence| d.channel == channel && d.covariates.len() == 1;
    let own = about.covariates.iter().find_map(|name| Covariate::ALL.into_iter().find(|c| c.name() == *name));
    let covariate = own.or_else(|| before.dependences.iter().find(strongest).map(|d| d.covariates[0]))?;
    let column = Column::new(values.into_iter().find(|v| v.covariate == covariate)?);

    let mut scenes = frames.clone();
    scenes.sort_unstable();
    scenes.dedup();
    let by_scene = scenes.len() >= 3;
    let blocks = if by_scene { scenes.len() } else { frames.len() };
    let bootstrap = Bootstrap::new(blocks, seed);
    let rays = changes.len() / frames.len().max(1);
    let cells = column.fine.count;
    let mut sums = vec![[0.0; 4]; blocks * cells];
    for i in 0..changes.len() {
        let [without, with] = [&residuals[0], &residuals[1]].map(|r| f64::from(r.physical[c][i]));
        if without.is_nan() || with.is_nan() {
            continue;
        }
        let frame = i / rays;
        let block = if by_scene { scenes.partition_point(|s| *s < frames[frame]) } else { frame };
        let sum = &mut sums[block * cells + usize::from(column.fine.of[i])];
        for (sum, x) in sum.iter_mut().zip([without, with, changes[i], 1.0]) {
            *sum += x;
        }
    }
    let piece = |(cell, (from, to)): (usize, (f64, f64))| {
        let of = |k: usize| (0..blocks).map(|b| sums[b * cells + cell][k]).collect::<Vec<f64>>();
        let n = of(3);
        (n.iter().sum::<f64>() > 0.0).then(|| Piece {
            from,
            to,
            without: bootstrap.ratio(&of(0), &n),
            effect: of(2).iter().sum::<f64>() / n.iter().sum::<f64>(),
            with: bootstrap.ratio(&of(1), &n),
        })
    };
    let pieces = column.fine.edges().enumerate().filter_map(piece).collect();
    Some(EffectCurve { effect: effect.into(), channel, covariate, pieces })
}

/// By how much an effect changes what a model says of a ray, ranges as far as residuals count.
fn change(channel: Channel, without: &Predicted, with: &Predicted, i: usize) -> f64 {
    let by = |of: &dyn Fn(&Predicted) -> f32| f64::from(of(with) - of(without));
    match channel {
        Channel::Range | Channel::Geometry => by(&|p| p.range_m[i]).clamp(-LARGEST_M, LARGEST_M),
        Channel::RangeVariance => by(&|p| 2.0 * p.sigma_m[i].max(1e-6).ln()),
        Channel::Reflectance => by(&|p| p.reflectance[i]),
        Channel::Missing => by(&|p| p.reported[i]),
        Channel::Extra => by(&|p| p.extra[i]),
    }
}
