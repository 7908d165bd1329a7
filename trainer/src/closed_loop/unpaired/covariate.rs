//! What reflectance and returns may depend on, each read off within strata that hold everything else.

use serde::Serialize;

use super::cells::{Cell, Cells, Chances, DARKEST, INCIDENCES, Makes, POWERS, RANGES, Stratum};
use super::evidence::{Columns, Evidence, Row};

/// Neighbouring rays see one surface: a cell of many rays says no more of others than this many.
const LIKE_RAYS: f64 = 8.0;

/// The slope over ln r below [`NEAR_M`]: what overlap of beam and receiver does.
pub(super) const NEAR: usize = 1;

/// Beams and receivers mostly overlap from here on, in m.
const NEAR_M: f64 = 10.0;

/// A covariate with the effect that would show over it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Over {
    /// ln reflectance over rings, of returns from one class of surface, in one direction, at one range and angle.
    Ring,
    /// ln reflectance over range, of returns from one class of surface in one direction.
    Range,
    /// ln reflectance over ln cos α, of the same.
    Incidence,
    /// Missing returns over the expected power, in one direction.
    Power,
}

/// How a half is looked at.
#[derive(Clone, Debug)]
pub(super) struct View<'a> {
    pub(super) elevations_rad: &'a [f64],
    /// What the sensor is known to make of reflectance, which is undone.
    pub(super) makes: Makes,
    /// Rings are only compared with themselves.
    pub(super) rings_differ: bool,
    /// ln of the power that is called weak: a quarter of all returns are expected to be weaker.
    pub(super) log_weak: f64,
}

impl Over {
    pub(super) const COUNT: usize = Self::ALL.len();
    pub(super) const ALL: [Self; 4] = [Self::Ring, Self::Range, Self::Incidence, Self::Power];

    /// The library's effect that has its trace here.
    pub fn effect(self) -> &'static str {
        match self {
            Self::Ring => "ring_gain",
            Self::Range => "reflectance_falloff",
            Self::Incidence => "incidence_falloff",
            Self::Power => "weak_return_drop",
        }
    }

    /// A number for each ring or bin.
    pub(super) fn table(self, cells: &Cells, frames: usize, view: &View) -> Evidence {
        let rings = view.elevations_rad.len();
        match self {
            Self::Ring => self.of_returns(cells, frames, view, rings, &|s, _| vec![(s.ring, 1.0)]),
            Self::Range => self.of_returns(cells, frames, view, RANGES, &|s, _| vec![(s.range, 1.0)]),
            Self::Incidence => self.of_returns(cells, frames, view, INCIDENCES, &|s, _| vec![(s.incidence, 1.0)]),
            Self::Power => of_chances(cells, frames, POWERS, &|power, _| (power, 1.0)),
        }
    }

    /// The numbers of the effect: slopes over range, far and near, over ln cos α, over ln P where it is weak; the table of the rings.
    pub(super) fn law(self, cells: &Cells, frames: usize, view: &View) -> Evidence {
        match self {
            Self::Range => self.of_returns(cells, frames, view, 2, &|_, c| {
                let range_m = c.range_m / c.rays;
                vec![(0, range_m), (NEAR, (range_m / NEAR_M).ln().min(0.0))]
            }),
            Self::Incidence => self.of_returns(cells, frames, view, 1, &|_, c| vec![(0, c.log_cosine / c.rays)]),
            Self::Power => of_chances(cells, frames, 1, &|_, log_power| (0, (view.log_weak - log_power).max(0.0))),
            Self::Ring => self.table(cells, frames, view),
        }
    }

    fn of_returns(
        self,
        cells: &Cells,
        frames: usize,
        view: &View,
        columns: usize,
        x: &dyn Fn(&Stratum, &Cell) -> Columns,
    ) -> Evidence {
        let row = |(stratum, cell): (&Stratum, &Cell)| {
            let (range_m, log_cosine) = (cell.range_m / cell.rays, cell.log_cosine / cell.rays);
            // On level ground, range and angle change with the ring even within a bin, and what is higher up in a street is darker or
            // brighter: gains are told but for what is smooth over elevation.
            let (held, nuisances) = if self == Self::Ring {
                let up = view.elevations_rad[stratum.ring] / ELEVATION_RAD;
                (Stratum { ring: 0, ..*stratum }, vec![range_m, log_cosine, up, up.powi(2), up.powi(3)])
            } else {
                let ring = if view.rings_differ { stratum.ring } else { 0 };
                (Stratum { ring, range: 0, incidence: 0, ..*stratum }, vec![])
            };
            let nuisances = nuisances.into_iter().enumerate().map(|(i, z)| (columns + i, z));
            let reflectance = (cell.reflectance / cell.rays).max(DARKEST);
            Row {
                stratum: held,
                weight: cell.rays / (1.0 + cell.rays / LIKE_RAYS),
                y: reflectance.ln() - view.makes.log_factor(stratum.ring, range_m, log_cosine),
                x: x(stratum, cell).into_iter().chain(nuisances).collect(),
            }
        };
        let nuisances = if self == Self::Ring { NUISANCES } else { 0 };
        Evidence::new(cells.returns.iter().map(row).collect(), columns + nuisances, nuisances, frames)
    }
}

/// Range, ln cos α, and elevation to the third power, as a scene may depend on them beside its rings.
const NUISANCES: usize = 5;

/// The unit in which elevations are raised to powers: some 20°.
const ELEVATION_RAD: f64 = 0.35;

/// Share of missing returns over expected power, within frame and sector.
fn of_chances(cells: &Cells, frames: usize, columns: usize, x: &dyn Fn(usize, f64) -> (usize, f64)) -> Evidence {
    let row = |([frame, _, sector, power], chances): (&[usize; 4], &Chances)| Row {
        stratum: [*frame, *sector],
        weight: chances.rays,
        y: chances.missing / chances.rays,
        x: vec![x(*power, chances.log_power / chances.rays)],
    };
    Evidence::new(cells.chances.iter().map(row).collect(), columns, 0, frames)
}
