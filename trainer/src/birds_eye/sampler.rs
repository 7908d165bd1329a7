//! Batches of both domains for the game; the same step gives the same batch, whenever it is drawn.

use anyhow::{Result, ensure};
use burn::tensor::{Device, Tensor, TensorData};
use lidar::birds_eye::{BirdsEye, CHANNELS, Grid};
use rand::{Rng, RngExt};

use super::scan::{Scan, Turn};
use crate::translation::sampler::Chance;

/// Share of a cut-out's cells that hold a return, at least. Instance norms divide by how much features vary: where hardly anything is seen,
/// gradients are multiplied by a hundred a layer, and networks of ten layers are lost at once.
const LEAST_OCCUPIED: f32 = 0.03;

/// Cut-outs that are drawn until one shows so much.
const ATTEMPTS: usize = 50;

/// Draws batches.
#[derive(Clone, Debug)]
pub(super) struct Sampler {
    pub(super) simulated: Vec<Scan>,
    pub(super) real: Vec<Scan>,
    pub(super) grid: Grid,
    pub(super) seed: u64,
    pub(super) batch: usize,
    /// Side of a cut-out, in cells.
    pub(super) side: usize,
}

impl Sampler {
    /// As many simulated as real cut-outs, each `[batch, channel, row, column]`, as networks see them.
    pub(super) fn pair(&self, step: usize, device: &Device) -> [Tensor<4>; 2] {
        [(&self.simulated, Chance::Simulated), (&self.real, Chance::Real)].map(|(scans, chance)| {
            let mut rng = chance.of(self.seed, step);
            let mut values = Vec::with_capacity(self.batch * CHANNELS * self.side * self.side);
            (0..self.batch).for_each(|_| values.extend(self.square(scans, &mut rng)));
            coded(Tensor::from_data(TensorData::new(values, [self.batch, CHANNELS, self.side, self.side]), device))
        })
    }

    /// Whether every scan shows as much as a cut-out has to.
    pub(super) fn check(&self) -> Result<()> {
        for (scans, name) in [(&self.simulated, "simulated.train"), (&self.real, "real.train")] {
            for (k, scan) in scans.iter().enumerate() {
                let found = occupied(scan.seen(&self.grid, Turn::default()).0.channel(CHANNELS - 1));
                ensure!(
                    found >= self.least(),
                    "{name}: scan {k} has returns in {found} cells, expected {} or more",
                    self.least()
                );
            }
        }
        Ok(())
    }

    /// Cells with returns that a cut-out has at least.
    fn least(&self) -> usize {
        (LEAST_OCCUPIED * (self.side * self.side) as f32).ceil() as usize
    }

    /// A cut-out of any of the scans, turned anyhow, that shows enough, or the most of all that were drawn, `[channel, row, column]`.
    fn square(&self, scans: &[Scan], rng: &mut impl Rng) -> Vec<f32> {
        let (mut most, mut fullest) = (0, vec![]);
        for _ in 0..ATTEMPTS {
            let scan = &scans[rng.random_range(0..scans.len())];
            let (seen, _) = scan.seen(&self.grid, Turn::random(rng));
            let corner = [0, 1].map(|_| rng.random_range(0..=self.grid.cells() - self.side));
            let square: Vec<f32> = cut(&seen, self.side, corner).collect();
            let found = occupied(&square[(CHANNELS - 1) * self.side * self.side..]);
            if found >= most {
                (most, fullest) = (found, square);
            }
            if most >= self.least() {
                break;
            }
        }
        fullest
    }
}

/// Cells with returns, of all cells' densities.
fn occupied(densities: &[f32]) -> usize {
    densities.iter().filter(|density| **density > 0.0).count()
}

/// From values, 0 to 1, to what networks see, −1 to 1; a cell without a return is −1 in all channels.
pub(super) fn coded(values: Tensor<4>) -> Tensor<4> {
    values * 2.0 - 1.0
}

/// Back, from what networks say.
pub(super) fn decoded(code: Tensor<4>) -> Tensor<4> {
    ((code + 1.0) / 2.0).clamp(0.0, 1.0)
}

/// A square of so many cells from a row and a column on.
fn cut(scan: &BirdsEye, side: usize, [top, left]: [usize; 2]) -> impl Iterator<Item = f32> {
    let cells = scan.cells;
    let from = move |row: usize| row / side * cells * cells + (top + row % side) * cells + left;
    (0..CHANNELS * side).flat_map(move |row| scan.values[from(row)..from(row) + side].iter().copied())
}

#[cfg(test)]
mod tests {
    use lidar::PointCloud;

    use super::*;

    #[test]
    fn cut_outs_show_something_and_the_same_step_the_same() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let mut cloud = PointCloud::new(1.0);
        // A corner full of returns, and nothing else.
        for i in 0..400 {
            cloud.x.push(4.1 + 0.2 * (i % 20) as f32);
            cloud.y.push(4.1 + 0.2 * (i / 20) as f32);
            cloud.z.push(0.0);
            cloud.intensity.push(0.5);
        }
        lidar::formats::write(&folder.path().join("corner.ply"), &cloud)?;
        let scans = Scan::read_all(folder.path(), None)?;
        let grid = Grid { reach_m: 16.0, cell_m: 0.5, height_m: [-1.0, 1.0] };
        let sampler = Sampler { simulated: scans.clone(), real: scans, grid, seed: 1, batch: 8, side: 16 };
        assert!(sampler.check().is_ok());
        let finer = Sampler { side: 64, ..sampler.clone() };
        assert!(finer.check().is_err_and(|e| e.to_string().starts_with("simulated.train: scan 0 has returns in ")));
        let values = |x: &Tensor<4>| x.to_data().iter::<f32>().collect::<Vec<f32>>();
        let device = Device::flex();
        let [simulated, real] = sampler.pair(3, &device);
        for square in values(&simulated).chunks(3 * 16 * 16) {
            assert!(square[2 * 16 * 16..].iter().filter(|density| **density > -1.0).count() >= 8);
        }
        assert_ne!(values(&simulated), values(&real));
        assert_eq!(values(&simulated), values(&sampler.pair(3, &device)[0]));
        assert_ne!(values(&simulated), values(&sampler.pair(4, &device)[0]));
        Ok(())
    }

    #[test]
    fn a_cut_out_is_a_square_of_the_scan_channel_by_channel() {
        let scan = BirdsEye { cells: 5, values: (0..75).map(|i| i as f32).collect() };
        let first = [11.0, 12.0, 16.0, 17.0];
        let expected = [first, first.map(|value| value + 25.0), first.map(|value| value + 50.0)].concat();
        assert_eq!(cut(&scan, 2, [2, 1]).collect::<Vec<f32>>(), expected);
    }
}
