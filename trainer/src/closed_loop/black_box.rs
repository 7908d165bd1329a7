//! The black box: a smooth table over whatever the residual depends on. It is the yardstick that every named effect has to hold its own
//! against, and what stands in for an effect that has no name.

use std::sync::Arc;

use super::candidate::Trial;
use super::evidence::evidence;
use super::halves::Halves;
use super::model::{SensorModel, Term};
use super::outcome::Unexplained;
use super::screen::{Dependence, Screening};
use crate::effects::smooth_table::{SmoothTable, Target};
use crate::effects::{Channel, Covariate, Effect, Evidence, Image};

/// Knots along a single covariate, and along each of two.
const KNOTS: [usize; 2] = [12, 7];

/// Least share of a channel's residual that a dependence has to explain to be tried, and largest probability of it by chance. That is no
/// claim yet: whether a table may be claimed its own gain says.
const LEAST_SHARE: f64 = 0.002;
const LARGEST_P: f64 = 0.05;

/// Share of a table's gain that a simpler one must reach to be preferred.
const NEARLY_AS_GOOD: f64 = 0.95;

/// Single covariates that are tried for a channel, best first.
const SINGLES: usize = 3;

/// A table that was tried.
#[derive(Clone, Debug)]
pub struct Table {
    /// The channel.
    pub channel: Channel,
    /// What it is over.
    pub covariates: Vec<Covariate>,
    /// Share of the channel's residual that these covariates explain, held out.
    pub share: f64,
    /// Probability of the table's gain by chance, times the number of dependences of the channel that were looked at (Bonferroni).
    pub q_value: f64,
    /// The table with its gain.
    pub trial: Trial,
}

impl Table {
    /// What the report says of it.
    pub fn unexplained(&self) -> Unexplained {
        Unexplained {
            channel: self.channel,
            covariates: self.covariates.iter().map(|c| c.name().to_owned()).collect(),
            share_of_residual: self.share,
            q_value: self.q_value,
            added_as_table: true,
        }
    }
}

/// The tables that a model could have.
pub struct Tables<'a> {
    model: &'a SensorModel,
    halves: &'a Halves<'a>,
    screening: &'a Screening,
    evidence: Evidence,
    images: Vec<Image>,
    least: &'a dyn Fn(&Term) -> f64,
}

impl<'a> Tables<'a> {
    /// For a model, from what its screening says. A table that gains less than `least`, nats a ray, where it is fitted to a sample is
    /// looked at no further, and cannot be claimed.
    pub fn new(
        model: &'a SensorModel,
        halves: &'a Halves<'a>,
        screening: &'a Screening,
        least: &'a dyn Fn(&Term) -> f64,
    ) -> Self {
        let images = halves.batches[0].iter().map(|batch| model.forward(batch.image.clone())).collect();
        Self { model, halves, screening, evidence: evidence(model, &halves.batches[0]), images, least }
    }

    /// The table that explains most of a channel's residual: of one covariate if that is nearly as good as of two. `None` where nothing
    /// depends on anything.
    pub fn best(&self, channel: Channel) -> Option<Table> {
        let depends = |d: &&Dependence| {
            d.channel == channel && d.p_value < LARGEST_P && d.share > LEAST_SHARE && !d.covariates.is_empty()
        };
        let of = |n: usize| self.screening.dependences.iter().filter(depends).filter(move |d| d.covariates.len() == n);
        let tried: Vec<Table> = of(1).take(SINGLES).chain(of(2).take(1)).flat_map(|d| self.tables(d)).collect();
        let most = tried.iter().map(|t| t.trial.gain.value).fold(f64::NEG_INFINITY, f64::max);
        tried.into_iter().filter(|t| most > 0.0 && t.trial.gain.value >= NEARLY_AS_GOOD * most).min_by(|a, b| {
            let simple = a.covariates.len().cmp(&b.covariates.len());
            simple.then(b.trial.gain.value.total_cmp(&a.trial.gain.value))
        })
    }

    /// Fits and scores the tables over what a dependence names.
    fn tables(&self, dependence: &Dependence) -> impl Iterator<Item = Table> {
        let looked_at = self.screening.dependences.iter().filter(|d| d.channel == dependence.channel).count();
        targets(dependence.channel).iter().filter_map(move |target| {
            let knots = KNOTS[dependence.covariates.len() - 1];
            let effect: Arc<dyn Effect> =
                Arc::new(SmoothTable::new(*target, &dependence.covariates, &self.images, knots));
            if self.model.has(effect.about().name) {
                return None;
            }
            let least = (self.least)(&Term::new(Arc::clone(&effect), self.evidence.rings));
            let trial = Trial::of(self.model, &effect, self.halves, &self.evidence, least);
            Some(Table {
                channel: dependence.channel,
                covariates: dependence.covariates.clone(),
                share: dependence.share,
                q_value: (trial.p_value * looked_at as f64).min(1.0),
                trial,
            })
        })
    }
}

/// What a table may change to mend a channel; nothing mends returns that no surface explains.
fn targets(channel: Channel) -> &'static [Target] {
    match channel {
        Channel::Range => &[Target::Range],
        Channel::RangeVariance => &[Target::RangeSpread],
        Channel::Reflectance => &[Target::Reflectance, Target::ReflectanceGain],
        Channel::Missing => &[Target::Missing],
        Channel::Geometry | Channel::Extra => &[],
    }
}
