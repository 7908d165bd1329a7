//! A scan seen from above: what many detectors look at.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Returns in one cell that count as dense: ln(N + 1)/ln 64, at most 1, as MV3D has it (Chen et al., "Multi-view 3D object detection
/// network for autonomous driving", 2017).
const DENSE: f32 = 64.0;

/// Most cells along a side: 4096² cells of three channels are 200 MB.
const MOST_CELLS: f32 = 4096.0;

/// Channels of a [`BirdsEye`].
pub const CHANNELS: usize = 3;

/// Corners of what is outlined in a picture of a scan, each its row and column: [`Grid::place`].
pub type Outline = [[f32; 2]; 4];

/// A square around the sensor, cut into cells; its frame is the sensor's: x ahead, y left, z up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// How far the square reaches ahead, behind, left and right, in metres.
    pub reach_m: f32,
    /// Side of a cell, in metres.
    pub cell_m: f32,
    /// Heights above the sensor, the lowest and the highest in metres, between which returns are seen.
    pub height_m: [f32; 2],
}

/// A grid that is none.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum GridError {
    /// The sizes make no square of at least one cell, or one of too many.
    #[error(
        "grid: cells of {cell_m} m in a square that reaches {reach_m} m, expected 1 to {MOST_CELLS} cells along a side"
    )]
    Cells {
        /// See [`Grid::reach_m`].
        reach_m: f32,
        /// See [`Grid::cell_m`].
        cell_m: f32,
    },
    /// The lowest height is not below the highest.
    #[error("grid: height_m is [{}, {}], expected the lowest before the highest", .0[0], .0[1])]
    Heights([f32; 2]),
}

/// One scan from above, `[channel, row, column]`, 0 to 1, 0 where a cell has no return: height of its highest return between the grid's
/// heights, reflectance of that return, and density of all of its returns. The first row is the farthest ahead, the first column the
/// farthest left.
#[derive(Clone, Debug, PartialEq)]
pub struct BirdsEye {
    /// Cells along a side.
    pub cells: usize,
    /// See above.
    pub values: Vec<f32>,
}

impl Grid {
    /// Whether anything can be seen in it.
    pub fn check(&self) -> Result<(), GridError> {
        let Self { reach_m, cell_m, height_m } = *self;
        let cells = 2.0 * reach_m / cell_m;
        if !(cell_m > 0.0 && (0.99..=MOST_CELLS).contains(&cells)) {
            return Err(GridError::Cells { reach_m, cell_m });
        }
        if height_m[0] < height_m[1] { Ok(()) } else { Err(GridError::Heights(height_m)) }
    }

    /// Cells along a side.
    pub fn cells(&self) -> usize {
        (2.0 * self.reach_m / self.cell_m).round() as usize
    }

    /// The row and the column of a place on the ground, in cells and parts of cells; whole numbers are cells' middles.
    pub fn place(&self, [x_m, y_m]: [f32; 2]) -> [f32; 2] {
        [x_m, y_m].map(|along| (self.reach_m - along) / self.cell_m - 0.5)
    }

    /// The place on the ground of a row and a column: [`place`](Self::place) the other way.
    pub fn on_ground(&self, [row, column]: [f32; 2]) -> [f32; 2] {
        [row, column].map(|cell| self.reach_m - (cell + 0.5) * self.cell_m)
    }

    /// The cell that holds a place on the ground, numbered row by row, if the square does.
    pub fn cell(&self, place_m: [f32; 2]) -> Option<usize> {
        let cells = self.cells();
        let [row, column] = self.place(place_m).map(f32::round);
        let within = |cell: f32| cell >= 0.0 && cell < cells as f32;
        (within(row) && within(column)).then(|| row as usize * cells + column as usize)
    }

    /// Returns from above, each x, y, z in metres and reflectance; those outside of the square or of its heights are not seen.
    pub fn see(&self, returns: impl IntoIterator<Item = [f32; 4]>) -> BirdsEye {
        let cells = self.cells();
        let [low, high] = self.height_m;
        let area = cells * cells;
        let mut values = vec![0.0; CHANNELS * area];
        let mut highest = vec![f32::NEG_INFINITY; area];
        for [x, y, z, reflectance] in returns {
            let Some(i) = self.cell([x, y]).filter(|_| (low..=high).contains(&z)) else { continue };
            values[2 * area + i] += 1.0;
            if z > highest[i] {
                highest[i] = z;
                values[i] = (z - low) / (high - low);
                values[area + i] = if reflectance > 0.0 { reflectance.min(1.0) } else { 0.0 };
            }
        }
        for count in &mut values[2 * area..] {
            *count = ((*count + 1.0).ln() / DENSE.ln()).min(1.0);
        }
        BirdsEye { cells, values }
    }
}

impl BirdsEye {
    /// One of the channels, row by row.
    pub fn channel(&self, channel: usize) -> &[f32] {
        let area = self.cells * self.cells;
        &self.values[channel * area..(channel + 1) * area]
    }

    /// Whether a cell holds a return.
    pub fn occupied(&self, cell: usize) -> bool {
        self.channel(2)[cell] > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four cells of 1 m along a side.
    const GRID: Grid = Grid { reach_m: 2.0, cell_m: 1.0, height_m: [-2.0, 2.0] };

    #[test]
    fn ahead_is_above_and_left_is_left() {
        assert_eq!(GRID.check(), Ok(()));
        let cell = |x, y| GRID.cell([x, y]);
        assert_eq!((cell(1.9, 1.9), cell(1.9, -1.9), cell(-1.9, 1.9)), (Some(0), Some(3), Some(12)));
        assert_eq!((cell(2.1, 0.0), cell(0.0, -2.1), cell(f32::NAN, 0.0)), (None, None, None));
        for place in [[1.3, -0.2], [-1.9, 0.7]] {
            let back = GRID.on_ground(GRID.place(place));
            assert!((back[0] - place[0]).abs() < 1e-6 && (back[1] - place[1]).abs() < 1e-6, "{back:?}");
        }
    }

    #[test]
    fn a_cell_shows_its_highest_return_and_how_many_there_are() {
        let above = [0.5, 0.5, 3.0, 1.0];
        let seen =
            GRID.see([[0.5, 0.5, -1.0, 0.2], [0.6, 0.4, 1.0, 0.7], above, [0.4, 0.6, 0.0, 0.9], [9.0, 0.0, 0.0, 1.0]]);
        let i = 4 + 1;
        assert_eq!((seen.channel(0)[i], seen.channel(1)[i]), (0.75, 0.7));
        assert!((seen.channel(2)[i] - 4f32.ln() / 64f32.ln()).abs() < 1e-6);
        assert!(seen.occupied(i) && seen.values.iter().filter(|value| **value > 0.0).count() == 3);
        let crowd = GRID.see(std::iter::repeat_n([0.5, 0.5, 0.0, 0.2], 1000));
        assert_eq!(crowd.channel(2)[i], 1.0);
    }

    #[test]
    fn what_is_no_number_is_not_seen() {
        let seen = GRID.see([[f32::NAN, 0.5, 0.0, 0.5], [0.5, 0.5, f32::NAN, 0.5], [1.5, 1.5, 0.0, f32::NAN]]);
        assert!(seen.values.iter().all(|value| value.is_finite()));
        assert_eq!((0..16).filter(|i| seen.occupied(*i)).count(), 1);
    }

    #[test]
    fn grids_of_nothing_or_of_too_much_are_refused() {
        for (reach_m, cell_m) in [(2.0, 0.0), (2.0, -1.0), (f32::NAN, 1.0), (1.0, 9.0), (1e9, 0.1), (2.0, f32::NAN)] {
            assert!(Grid { reach_m, cell_m, ..GRID }.check().is_err(), "{reach_m} {cell_m}");
        }
        assert_eq!(Grid { height_m: [1.0, 1.0], ..GRID }.check(), Err(GridError::Heights([1.0, 1.0])));
    }
}
