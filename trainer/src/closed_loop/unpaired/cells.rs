//! A scan reduced to cells: rays of one ring that see the same kind of surface in one direction, at one range, at one angle.

use std::collections::BTreeMap;
use std::ops::Add;

use lidar::{RangeImage, Sensor};

use super::falloff::Falloff;
use crate::closed_loop::lay::{Kind, Lay, ground_m, lays};

/// Sectors of a turn.
const SECTORS: usize = 32;

/// Bins an octave of range.
const BINS_PER_OCTAVE: f64 = 2.0;

/// Bins of range, from 1 m on: up to 181 m.
pub(super) const RANGES: usize = 15;

/// Bins of incidence, and the width of each in degrees.
pub(super) const INCIDENCES: usize = 9;
pub(super) const INCIDENCE_DEG: f64 = 10.0;

/// Bins of ln P, a unit wide, P = ρ·cos α/r² in 1/m²; the first one also takes what is weaker.
pub(super) const POWERS: usize = 12;
const WEAKEST: f64 = -14.0;

/// Heights above the ground, in m, up to which it is ground, and from which on a wall is no car.
const GROUND_M: f64 = 0.5;
const CAR_M: f64 = 2.0;

/// Columns to either side of a ray in which its surface has to be seen.
const REACH: usize = 3;

/// Two sightings are of one surface if the plane of one is met this close to the plane of the other, relative to the range.
const SAME_SURFACE: f64 = 0.03;

/// What it is and where it is seen: what rays have to share to be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Stratum {
    pub(super) frame: usize,
    pub(super) class: u8,
    pub(super) ring: usize,
    pub(super) sector: usize,
    pub(super) range: usize,
    pub(super) incidence: usize,
}

/// Returns of one stratum.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cell {
    pub(super) rays: f64,
    /// Sums over the rays.
    pub(super) reflectance: f64,
    pub(super) range_m: f64,
    pub(super) log_cosine: f64,
}

/// Rays of one ring, sector, and expected power that had a surface to return from.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Chances {
    pub(super) rays: f64,
    pub(super) missing: f64,
    /// Sum of ln P.
    pub(super) log_power: f64,
}

/// A scan in cells.
#[derive(Clone, Debug, Default)]
pub(super) struct Cells {
    pub(super) returns: BTreeMap<Stratum, Cell>,
    /// By frame, ring, sector and bin of power.
    pub(super) chances: BTreeMap<[usize; 4], Chances>,
}

/// Chances by bin of power.
pub(super) type Powers = [Chances; POWERS];

/// What a sensor makes of reflectance.
#[derive(Clone, Debug, Default)]
pub(super) struct Makes {
    /// ln of each ring's gain; 0 where there is none.
    pub(super) log_gains: Vec<f64>,
    pub(super) falloff: Falloff,
    /// p of cosᵖ α.
    pub(super) exponent: f64,
}

/// A ray between two returns of one surface: what it should have returned.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    pub(super) log_power: f64,
    pub(super) missing: bool,
}

impl Cells {
    /// Adds the returns of a scan, whose classes count if `labelled`.
    pub(super) fn add_returns(&mut self, frame: usize, image: &RangeImage, sensor: &Sensor, labelled: bool) {
        let lays = lays(image, sensor);
        let ground_m = ground_m(&lays);
        let columns = image.columns();
        for (i, lay) in lays.iter().enumerate() {
            let Some(lay) = lay else { continue };
            let stratum = Stratum {
                frame,
                class: if labelled { 8 + image.class()[i] } else { class(lay, ground_m) },
                ring: i / columns,
                sector: sector(i % columns, columns),
                range: ((BINS_PER_OCTAVE * lay.range_m.max(1.0).log2()) as usize).min(RANGES - 1),
                incidence: ((lay.cos_incidence.acos().to_degrees() / INCIDENCE_DEG) as usize).min(INCIDENCES - 1),
            };
            let cell = self.returns.entry(stratum).or_default();
            cell.rays += 1.0;
            cell.reflectance += f64::from(image.reflectance()[i]);
            cell.range_m += lay.range_m;
            cell.log_cosine += lay.cos_incidence.ln();
        }
    }

    /// Adds the rays of a scan that should have returned, their surfaces' reflectance freed of what the sensor makes of it.
    pub(super) fn add_chances(&mut self, frame: usize, image: &RangeImage, sensor: &Sensor, makes: &Makes) {
        let columns = image.columns();
        for (i, expected) in expected(image, sensor, &lays(image, sensor), makes) {
            let power = (expected.log_power - WEAKEST).max(0.0) as usize;
            let place = [frame, i / columns, sector(i % columns, columns), power.min(POWERS - 1)];
            let chances = self.chances.entry(place).or_default();
            chances.rays += 1.0;
            chances.missing += f64::from(u8::from(expected.missing));
            chances.log_power += expected.log_power;
        }
    }

    /// Forgets the returns where not even a dark surface is as strong as this: where dark ones are lost, the bright ones that are left make
    /// what is far look bright.
    pub(super) fn keep_strong(&mut self, log_power: f64) {
        self.returns.retain(|_, cell| {
            let log_range = (cell.range_m / cell.rays).ln();
            DARK.ln() + cell.log_cosine / cell.rays - 2.0 * log_range >= log_power
        });
    }

    /// The chances by bin of power.
    pub(super) fn powers(&self) -> Powers {
        let mut powers = Powers::default();
        for ([.., power], chances) in &self.chances {
            powers[*power] = powers[*power] + *chances;
        }
        powers
    }
}

impl Add for Chances {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            rays: self.rays + other.rays,
            missing: self.missing + other.missing,
            log_power: self.log_power + other.log_power,
        }
    }
}

impl Makes {
    /// ln of reported over true reflectance.
    pub(super) fn log_factor(&self, ring: usize, range_m: f64, log_cosine: f64) -> f64 {
        let gain = self.log_gains.get(ring).copied().unwrap_or(0.0);
        gain + self.falloff.log(range_m) + self.exponent * log_cosine
    }
}

/// Middle of a bin of range, in m.
pub(super) fn range_m(bin: usize) -> f64 {
    2.0_f64.powf((bin as f64 + 0.5) / BINS_PER_OCTAVE)
}

/// Middle of a bin of ln P.
pub(super) fn log_power(bin: usize) -> f64 {
    WEAKEST + bin as f64 + 0.5
}

fn sector(column: usize, columns: usize) -> usize {
    column * SECTORS / columns
}

/// Ground, what else is level, what is upright and as low as a car, what is upright and higher.
fn class(lay: &Lay, ground_m: f64) -> u8 {
    let above_m = lay.height_m - ground_m;
    match lay.kind {
        Kind::Level if above_m < GROUND_M => 0,
        Kind::Level => 1,
        Kind::Upright if above_m < CAR_M => 2,
        Kind::Upright => 3,
    }
}

/// Every ray that passes between two returns of one surface, whether it returned or not.
///
/// Its own return is not looked at: what is expected of a ray must not depend on what became of it.
pub(super) fn expected<'a>(
    image: &'a RangeImage,
    sensor: &'a Sensor,
    lays: &'a [Option<Lay>],
    makes: &'a Makes,
) -> impl Iterator<Item = (usize, Expected)> + 'a {
    let columns = image.columns();
    let beside = move |i: usize, step: usize| {
        let row = i - i % columns;
        let next = (1..=REACH).map(|n| row + (i % columns + n * step) % columns);
        next.into_iter().find(|j| image.range_m()[*j] > 0.0)
    };
    (0..lays.len()).filter_map(move |i| {
        let (left, right) = (beside(i, columns - 1)?, beside(i, 1)?);
        let direction = sensor.direction(i / columns, i % columns);
        let seen = |j: usize| Lay::seen(lays[j]?.plane, direction);
        let (a, b) = (seen(left)?, seen(right)?);
        let range_m = f64::midpoint(a.range_m, b.range_m);
        if a.kind != b.kind || (a.range_m - b.range_m).abs() > SAME_SURFACE * range_m {
            return None;
        }
        let reflectance = f64::from(image.reflectance()[left] + image.reflectance()[right]) / 2.0;
        let log_reflectance =
            reflectance.max(DARKEST).ln() - makes.log_factor(i / columns, range_m, a.cos_incidence.ln());
        let log_power = log_reflectance + a.cos_incidence.ln() - 2.0 * range_m.ln();
        Some((i, Expected { log_power, missing: image.range_m()[i] <= 0.0 }))
    })
}

/// Reflectance of a dark surface: asphalt in the near infrared.
const DARK: f64 = 0.1;

/// Half a step of a sensor that reports reflectance in hundredths: below it, a logarithm says nothing.
pub(super) const DARKEST: f64 = 0.005;
