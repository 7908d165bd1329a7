//! Cells of a covariate.

use super::covariates::Values;
use crate::effects::Covariate;

/// Values from which quantiles are found.
const LOOKED_AT: usize = 20_000;

/// Most cells of a covariate that has a cell a value.
const MOST_NAMED: usize = 128;

/// Cells of a number, and of a place in the turn: for itself, and for tables over two covariates.
const NUMBER: [usize; 2] = [12, 8];
const TURN: [usize; 2] = [36, 12];

/// A covariate of every ray, as numbers of cells.
#[derive(Clone, Debug)]
pub(super) struct Column {
    pub(super) covariate: Covariate,
    pub(super) fine: Bins,
    pub(super) coarse: Bins,
}

/// Cells, and which of them each ray is in.
#[derive(Clone, Debug)]
pub(super) struct Bins {
    /// Number of cells, the last of which holds the rays without a value.
    pub(super) count: usize,
    pub(super) of: Vec<u8>,
    edges: Vec<(f64, f64)>,
}

impl Column {
    pub(super) fn new(of: Values) -> Self {
        let Values { covariate, values } = of;
        let every = (values.len() / LOOKED_AT).max(1);
        // A stride that shares no factor with the columns, or the sample would see a few columns alone.
        let mut some: Vec<f32> = values.iter().copied().step_by(every | 1).filter(|v| v.is_finite()).collect();
        some.sort_by(f32::total_cmp);
        let [fine, coarse] = match covariate {
            Covariate::Ring | Covariate::Class | Covariate::Frame => {
                let mut named: Vec<f32> = values.iter().copied().filter(|v| v.is_finite()).collect();
                named.sort_by(f32::total_cmp);
                named.dedup();
                let bins = if named.len() <= MOST_NAMED {
                    Bins::at(&values, named.iter().map(|v| (*v, *v)).collect())
                } else {
                    Bins::quantiles(&values, &some, MOST_NAMED)
                };
                [bins.clone(), bins]
            }
            Covariate::Azimuth | Covariate::SweepPhase => TURN.map(|n| Bins::even(&values, &some, n)),
            _ => NUMBER.map(|n| Bins::quantiles(&values, &some, n)),
        };
        Self { covariate, fine, coarse }
    }
}

impl Bins {
    /// Lower and upper edges of the cells.
    pub(super) fn edges(&self) -> impl Iterator<Item = (f64, f64)> {
        self.edges.iter().copied()
    }

    fn quantiles(values: &[f32], sorted: &[f32], n: usize) -> Self {
        let mut cuts: Vec<f32> =
            (0..=n).filter_map(|i| sorted.get((sorted.len().saturating_sub(1)) * i / n).copied()).collect();
        cuts.dedup();
        if cuts.len() == 1 {
            cuts.push(cuts[0]);
        }
        Self::at(values, cuts.windows(2).map(|w| (w[0], w[1])).collect())
    }

    fn even(values: &[f32], sorted: &[f32], n: usize) -> Self {
        let (from, to) = (sorted.first().copied().unwrap_or(0.0), sorted.last().copied().unwrap_or(1.0));
        let cut = |i: usize| from + (to - from) * i as f32 / n as f32;
        Self::at(values, (0..n).map(|i| (cut(i), cut(i + 1))).collect())
    }

    /// A ray is in the last cell whose lower edge it reaches.
    fn at(values: &[f32], edges: Vec<(f32, f32)>) -> Self {
        let none = edges.len() as u8;
        let of = values
            .iter()
            .map(|v| if v.is_nan() { none } else { edges.partition_point(|e| e.0 <= *v).saturating_sub(1) as u8 })
            .collect();
        let edges: Vec<(f64, f64)> = edges.into_iter().map(|(a, b)| (f64::from(a), f64::from(b))).collect();
        Self { count: edges.len() + 1, of, edges }
    }
}
