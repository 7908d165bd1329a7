//! How the residual depends on what is known of each ray: every covariate and every pair of them, in every channel, held out.
//!
//! A dependence is fitted on half of the blocks (scenes) as a table of cell means and scored on the other half, and the other way round:
//! its share is Σ(y − mean)² − Σ(y − table)² over Σ(y − mean)², summed over blocks that the table has not seen, so chance scores
//! below 0. A pair counts what it adds over the sum of its two singles.

mod bins;
mod cells;
mod covariates;
mod effect_curve;
mod residual;
mod seam;

use std::collections::BTreeSet;

use rayon::prelude::*;
use serde::Serialize;

use self::bins::Column;
use self::cells::{Cells, additive, cross_validated, steps};
use self::residual::Residuals;
use super::data::Batch;
use super::model::SensorModel;
use super::outcome::Interval;
use super::predicted::Predicted;
use super::resample::Bootstrap;
use super::significance::{Block, benjamini_hochberg, p_value};
use crate::effects::{Channel, Covariate};

pub use self::effect_curve::{EffectCurve, Piece, effect_curve};
pub use self::residual::{CHANNELS, unit};

/// A screening.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Screening {
    /// Every dependence that was looked at, the largest share first.
    pub dependences: Vec<Dependence>,
    /// Mean residual of every ray of the sensor, a map a channel.
    #[serde(skip)]
    pub maps: Vec<Map>,
}

/// How one channel's residual depends on one covariate, or on two together.
#[derive(Clone, Debug, Serialize)]
pub struct Dependence {
    /// The channel.
    pub channel: Channel,
    /// None (a residual that is not 0 on average), one or two.
    pub covariates: Vec<Covariate>,
    /// Share of the standardised residual's sum of squares that it explains in scenes that it was not fitted on; a pair's beyond its singles.
    pub share: f64,
    /// Its 95 % interval, from a bootstrap over scenes.
    pub ci95: [f64; 2],
    /// Probability of such a share where there is no dependence.
    pub p_value: f64,
    /// The same, adjusted for everything that the screening looked at (Benjamini and Hochberg 1995).
    pub q_value: f64,
    /// Mean residual along a single covariate; empty for pairs.
    pub curve: Vec<Bin>,
}

/// A piece of a curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bin {
    /// Lower edge, in the covariate's unit.
    pub from: f64,
    /// Upper edge.
    pub to: f64,
    /// Mean residual of its rays, in [`unit`]s of the channel.
    pub mean: f64,
    /// Its 95 % interval, from a bootstrap over scenes.
    pub ci95: [f64; 2],
    /// Number of its rays.
    pub rays: usize,
}

/// Mean residual of each ray of the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// The channel.
    pub channel: Channel,
    /// Number of columns.
    pub columns: usize,
    /// Means in [`unit`]s of the channel, `[ring, column]`; NaN where nothing was measured.
    pub mean: Vec<f32>,
}

impl Screening {
    /// The dependence of a channel on these covariates.
    pub fn of(&self, channel: Channel, covariates: &[Covariate]) -> Option<&Dependence> {
        self.dependences.iter().find(|d| d.channel == channel && d.covariates == covariates)
    }
}

/// Screens what a model leaves unexplained of these batches. Empty if there are fewer than two frames: nothing could be held out.
pub fn screen(model: &SensorModel, batches: &[&Batch], seed: u64) -> Screening {
    let Some(sheet) = Sheet::new(model, batches) else { return Screening::default() };
    let bootstrap = Bootstrap::new(sheet.blocks, seed);
    let fold = cells::halves(sheet.blocks, seed);
    let mut entries = vec![Entry::Constant];
    entries.extend((0..sheet.columns.len()).map(Entry::Single));
    for a in 0..sheet.columns.len() {
        entries.extend((a + 1..sheet.columns.len()).map(|b| Entry::Pair(a, b)));
    }
    // Frames are not shared between halves, so a table over frames and something else has no cell to be scored in. Azimuth and
    // sweep phase are functions of one another: a table over both is one over either.
    entries.retain(|entry| {
        let Entry::Pair(a, b) = entry else { return true };
        let pair = [sheet.columns[*a].covariate, sheet.columns[*b].covariate];
        !pair.contains(&Covariate::Frame) && pair != [Covariate::Azimuth, Covariate::SweepPhase]
    });
    let judge = |entry: &Entry| {
        (0..CHANNELS.len()).filter_map(|c| sheet.judge(*entry, c, &fold, &bootstrap)).collect::<Vec<_>>()
    };
    let mut dependences: Vec<Dependence> = entries.par_iter().map(judge).collect::<Vec<_>>().concat();
    seam::choose(&sheet, &fold, &mut dependences);
    let q = benjamini_hochberg(&dependences.iter().map(|d| d.p_value).collect::<Vec<_>>());
    dependences.iter_mut().zip(q).for_each(|(d, q)| d.q_value = q);
    dependences.sort_by(|a, b| b.share.total_cmp(&a.share));
    Screening { dependences, maps: sheet.residuals.maps(sheet.size) }
}

/// Everything about every ray, side by side.
struct Sheet {
    residuals: Residuals,
    columns: Vec<Column>,
    /// Number of each frame's block.
    block_of: Vec<usize>,
    blocks: usize,
    size: [usize; 2],
}

#[derive(Clone, Copy, Debug)]
enum Entry {
    Constant,
    Single(usize),
    Pair(usize, usize),
}

impl Sheet {
    fn new(model: &SensorModel, batches: &[&Batch]) -> Option<Self> {
        let parts: Vec<(Predicted, Vec<covariates::Values>)> = batches
            .par_iter()
            .map(|batch| {
                let image = model.forward(batch.image.clone());
                (Predicted::of(&image, batch), covariates::of(&image, batch.observed.range_m.dims()))
            })
            .collect();
        let size = parts.first()?.0.size;
        let frames: Vec<(usize, usize)> =
            parts.iter().flat_map(|(p, _)| p.frames.iter().map(|f| (p.scene, *f))).collect();
        let scenes: Vec<usize> = frames.iter().map(|f| f.0).collect::<BTreeSet<_>>().into_iter().collect();
        let by_scene = scenes.len() >= 3;
        let block_of: Vec<usize> = frames
            .iter()
            .enumerate()
            .map(|(i, (scene, _))| if by_scene { scenes.partition_point(|s| s < scene) } else { i })
            .collect();
        let blocks = if by_scene { scenes.len() } else { frames.len() };
        if blocks < 2 {
            return None;
        }
        let mut residuals = Residuals::default();
        let mut values: Vec<covariates::Values> = Vec::new();
        for (predicted, of) in parts {
            residuals.add(&predicted);
            if values.is_empty() {
                values = of;
            } else {
                values.iter_mut().zip(of).for_each(|(all, of)| all.values.extend(of.values));
            }
        }
        let columns = values.into_par_iter().map(Column::new).collect();
        Some(Self { residuals, columns, block_of, blocks, size })
    }

    /// Sums over the rays of each block and cell; `coarse` for tables over two.
    fn tables(&self, entry: Entry, residual: &[f32]) -> Vec<Cells> {
        let cells = match entry {
            Entry::Constant => 1,
            Entry::Single(a) => self.columns[a].fine.count,
            Entry::Pair(a, b) => self.columns[a].coarse.count * self.columns[b].coarse.count,
        };
        let rays = self.size[0] * self.size[1];
        let mut tables = vec![Cells::empty(cells); self.blocks];
        for (frame, residual) in residual.chunks(rays).enumerate() {
            let rays = frame * rays..(frame + 1) * rays;
            let table = &mut tables[self.block_of[frame]];
            match entry {
                Entry::Constant => residual.iter().for_each(|y| table.add(0, *y)),
                Entry::Single(a) => {
                    let of = &self.columns[a].fine.of[rays];
                    of.iter().zip(residual).for_each(|(a, y)| table.add(usize::from(*a), *y));
                }
                Entry::Pair(a, b) => {
                    let (a, b) = (&self.columns[a].coarse, &self.columns[b].coarse);
                    let of = a.of[rays.clone()].iter().zip(&b.of[rays]);
                    of.zip(residual).for_each(|((i, j), y)| table.add(usize::from(*i) * b.count + usize::from(*j), *y));
                }
            }
        }
        tables
    }

    fn judge(&self, entry: Entry, channel: usize, fold: &[bool], bootstrap: &Bootstrap) -> Option<Dependence> {
        let tables = self.tables(entry, &self.residuals.standardised[channel]);
        let of = |fit: &(dyn Fn(&Cells) -> Vec<f64> + Sync)| cross_validated(&tables, fold, fit);
        let scored = match entry {
            Entry::Constant => cells::of_the_mean(&tables, fold),
            Entry::Single(a) if self.columns[a].covariate == Covariate::Frame => of(&|train| cells::trend(train)),
            Entry::Single(_) => of(&steps),
            Entry::Pair(a, b) => {
                let size = [self.columns[a].coarse.count, self.columns[b].coarse.count];
                of(&steps).beyond(&of(&|train| additive(train, size)))
            }
        };
        let whole: f64 = scored.whole.iter().sum();
        if whole <= 0.0 {
            return None;
        }
        let share = bootstrap.ratio(&scored.gain, &scored.whole);
        let sums: Vec<Block> = scored.gain.iter().map(|g| Block { scene: 0, sum: *g }).collect();
        let (covariates, curve) = match entry {
            Entry::Constant => (vec![], vec![]),
            Entry::Single(a) => (vec![self.columns[a].covariate], self.curve(a, channel, bootstrap)),
            Entry::Pair(a, b) => (vec![self.columns[a].covariate, self.columns[b].covariate], vec![]),
        };
        let p_value = p_value(&sums);
        let channel = CHANNELS[channel];
        Some(Dependence { channel, covariates, share: share.value, ci95: share.ci95, p_value, q_value: 1.0, curve })
    }

    fn curve(&self, column: usize, channel: usize, bootstrap: &Bootstrap) -> Vec<Bin> {
        let tables = self.tables(Entry::Single(column), &self.residuals.physical[channel]);
        let bin = |(i, (from, to)): (usize, (f64, f64))| {
            let list = |of: &dyn Fn(&Cells) -> f64| tables.iter().map(of).collect::<Vec<f64>>();
            let (sum, n) = (list(&|t| t.sum[i]), list(&|t| t.n[i]));
            let rays = n.iter().sum::<f64>() as usize;
            let Interval { value: mean, ci95 } = bootstrap.ratio(&sum, &n);
            (rays > 0).then_some(Bin { from, to, mean, ci95, rays })
        };
        self.columns[column].fine.edges().enumerate().filter_map(bin).collect()
    }
}

#[cfg(test)]
mod tests;
