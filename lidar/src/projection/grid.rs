//! The pixel of each point, from its ring and its azimuth.

#![allow(
    clippy::inline_always,
    reason = "a loop is compiled for the processor at hand only where all of it is inlined"
)]

use std::f64::consts::TAU;

use pulp::{Arch, NullaryFnOnce};

use super::{NO_PIXEL, Polar};
use crate::azimuth::asin_turns;
use crate::cloud::PointCloud;
use crate::sensor::{MAX_RINGS, Sensor};
use crate::whole::whole_part;

/// A sensor's grid of pixels, in single precision.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    frame: Frame,
    /// Straight if every beam leaves the spin axis along the encoder's azimuth.
    straight: bool,
    /// Offset in turns and distance beside the axis in metres, by ring; of [`MAX_RINGS`], so that a masked index is inside.
    beams: Vec<(f32, f32)>,
}

/// What a point has to lie in. Loops work on a copy: what lies behind a reference might change with every pixel that they write.
#[derive(Clone, Copy, Debug)]
struct Frame {
    rings: u32,
    columns: u32,
    limits_m: (f32, f32),
}

/// Points that are looked at together.
const BLOCK: usize = 64;

impl Grid {
    pub(super) fn new(sensor: &Sensor) -> Self {
        let rings = sensor.rings();
        // Whole turns taken away, for small numbers are the more precise.
        let part_of_turn = |rad: f64| (rad / TAU - (rad / TAU).round()) as f32;
        let mut beams: Vec<(f32, f32)> =
            rings.iter().map(|r| (part_of_turn(r.azimuth_offset_rad), r.lateral_m as f32)).collect();
        let straight = beams.iter().all(|beam| *beam == (0.0, 0.0));
        beams.resize(MAX_RINGS, (0.0, 0.0));
        let (rings, columns) = (rings.len() as u32, sensor.columns() as u32);
        Self { frame: Frame { rings, columns, limits_m: sensor.range_limits_m() }, straight, beams }
    }

    /// Fills `pixels` with the pixel of each point, [`NO_PIXEL`] for a point that no ring sees or whose range is none or beyond the limits.
    pub(super) fn pixels(&self, cloud: &PointCloud, polar: &Polar, rows: &[u16], pixels: &mut [u32]) {
        Arch::new().dispatch(Filling { grid: self, cloud, polar, rows, pixels });
    }
}

impl Frame {
    /// The pixel of a point `turn` clockwise from straight behind, in turns of −2 to 2.
    #[inline(always)]
    fn pixel(self, row: u32, turn: f32, range_m: f32) -> u32 {
        // A hair before straight behind rounds to a whole turn.
        let column = whole_part((turn - turn.floor()) * self.columns as f32);
        let column = if column < self.columns { column } else { self.columns - 1 };
        let seen = row < self.rings && range_m > 0.0 && range_m >= self.limits_m.0 && range_m <= self.limits_m.1;
        // At most MAX_RINGS · MAX_COLUMNS where it is seen; a checked product would keep the loops from being vectorised.
        if seen { row.wrapping_mul(self.columns).wrapping_add(column) } else { NO_PIXEL }
    }
}

/// Pixels to be filled: no closure, for a long one would not be inlined, nor compiled for the processor at hand.
struct Filling<'a> {
    grid: &'a Grid,
    cloud: &'a PointCloud,
    polar: &'a Polar,
    rows: &'a [u16],
    pixels: &'a mut [u32],
}

impl NullaryFnOnce for Filling<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        if self.grid.straight {
            self.straight();
        } else {
            self.turned();
        }
    }
}

impl Filling<'_> {
    #[inline(always)]
    fn straight(self) {
        let Self { grid, polar, rows, pixels, .. } = self;
        let frame = grid.frame;
        for (((pixel, &turn), &range_m), &row) in pixels.iter_mut().zip(&polar.turns).zip(&polar.range_m).zip(rows) {
            *pixel = frame.pixel(u32::from(row), 0.5 - turn, range_m);
        }
    }

    #[inline(always)]
    fn turned(self) {
        let Self { grid, cloud, polar, rows, pixels } = self;
        let frame = grid.frame;
        let beams: &[(f32, f32); MAX_RINGS] =
            grid.beams.as_slice().try_into().unwrap_or_else(|_| unreachable!("made that long"));
        let (mut offset_turns, mut lateral_m) = ([0.0f32; BLOCK], [0.0f32; BLOCK]);
        let points = pixels.chunks_mut(BLOCK).zip(rows.chunks(BLOCK));
        let polar = polar.turns.chunks(BLOCK).zip(polar.range_m.chunks(BLOCK));
        let places = cloud.x.chunks(BLOCK).zip(cloud.y.chunks(BLOCK));
        for (((pixels, rows), (turns, range_m)), (x, y)) in points.zip(polar).zip(places) {
            // First the table, point by point, then the arithmetic, which vectorises.
            for ((&row, offset_turns), lateral_m) in rows.iter().zip(&mut offset_turns).zip(&mut lateral_m) {
                (*offset_turns, *lateral_m) = beams[usize::from(row) % MAX_RINGS];
            }
            let points = pixels.iter_mut().zip(rows).zip(turns).zip(range_m);
            let beams = x.iter().zip(y).zip(&offset_turns).zip(&lateral_m);
            for ((((pixel, &row), &turn), &range_m), (((&x, &y), &offset), &lateral_m)) in points.zip(beams) {
                let away_m = (x * x + y * y).sqrt();
                let beside = asin_turns(lateral_m / if away_m > 0.0 { away_m } else { 1.0 });
                *pixel = frame.pixel(u32::from(row), 0.5 - turn + offset + beside, range_m);
            }
        }
    }
}
