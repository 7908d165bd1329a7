//! Scans as they are seen from above, with the vehicles that their labels show.

use std::path::Path;

use anyhow::{Context, Result};
use lidar::birds_eye::{BirdsEye, Grid};
use lidar::projection::NO_PIXEL;
use lidar::{PointCloud, Projector, formats};
use rand::{Rng, RngExt};

use super::vehicles::Vehicles;
use crate::data::scans::scan_files;

/// A scan's returns, and the vehicles among them.
#[derive(Clone, Debug)]
pub struct Scan {
    /// x, y, z in metres, and reflectance.
    returns: Vec<[f32; 4]>,
    /// Those that its labels show; none where it has no labels.
    pub vehicles: Vehicles,
    /// Whether it has labels.
    pub labelled: bool,
}

/// How a scan is varied: seen from above, every direction is as good as any other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Turn {
    /// It is turned by so much about the sensor, counter-clockwise,
    pub yaw_rad: f32,
    /// once it is mirrored at the sensor's x axis, if it is to be.
    pub mirrored: bool,
}

impl Turn {
    /// Any.
    pub fn random(rng: &mut impl Rng) -> Self {
        Self { yaw_rad: rng.random_range(0.0..std::f32::consts::TAU), mirrored: rng.random_bool(0.5) }
    }
}

impl Scan {
    /// The scans of a folder, files of any format, in the order of their names; where there is a projector, without the points that lose
    /// their pixel on its grid to a nearer one.
    pub fn read_all(folder: &Path, mut projector: Option<Projector>) -> Result<Vec<Self>> {
        let read = |file: &Path| -> Result<Self> {
            Self::of(&formats::read(file, &formats::Limits::default())?, projector.as_mut())
        };
        let files = scan_files(folder)?;
        let scans = files.iter().map(Path::new).map(read);
        scans.zip(&files).map(|(scan, file)| scan.with_context(|| format!("scan {}", file.display()))).collect()
    }

    /// A cloud's.
    fn of(cloud: &PointCloud, projector: Option<&mut Projector>) -> Result<Self> {
        let whole = projector.map(|projector| projector.project(cloud)).transpose()?.map(|whole| whole.pixel_of_point);
        let kept = |i: &usize| match &whole {
            Some(pixels) => pixels[*i] != NO_PIXEL,
            None => cloud.range_m(*i).is_finite(),
        };
        let kept: Vec<u32> = (0..cloud.len()).filter(kept).map(|i| i as u32).collect();
        let cloud = cloud.select(&kept);
        let of = |i| [cloud.x[i], cloud.y[i], cloud.z[i], cloud.intensity[i] / cloud.full_scale];
        let returns = (0..cloud.len()).map(of).collect();
        Ok(Self { returns, vehicles: Vehicles::of(&cloud), labelled: cloud.label.is_some() })
    }

    /// From above, turned; and the vehicles, turned with it.
    pub fn seen(&self, grid: &Grid, turn: Turn) -> (BirdsEye, Vehicles) {
        let Turn { yaw_rad, mirrored } = turn;
        let (sin, cos) = yaw_rad.sin_cos();
        let side = if mirrored { -1.0 } else { 1.0 };
        let turned = self.returns.iter().map(|[x, y, z, reflectance]| {
            let y = side * y;
            [x * cos - y * sin, x * sin + y * cos, *z, *reflectance]
        });
        (grid.see(turned), self.vehicles.turned(yaw_rad, mirrored))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::birds_eye::Footprint;

    #[test]
    fn a_scan_turns_with_its_vehicles() {
        let grid = Grid { reach_m: 16.0, cell_m: 0.25, height_m: [-2.0, 2.0] };
        let place = Footprint::new([7.0, 3.0], [4.0, 1.8], 0.2);
        let returns = place.corners().map(|[x, y]| [x, y, 0.0, 0.5]).to_vec();
        let vehicles = Vehicles { clear: vec![place], unclear: vec![] };
        let scan = Scan { returns, vehicles, labelled: true };
        for turn in [Turn::default(), Turn { yaw_rad: 2.0, mirrored: false }, Turn { yaw_rad: -0.4, mirrored: true }] {
            let (seen, vehicles) = scan.seen(&grid, turn);
            let corners = vehicles.clear[0].corners();
            for cell in (0..seen.values.len() / 3).filter(|i| seen.occupied(*i)) {
                let at = grid.on_ground([(cell / seen.cells) as f32, (cell % seen.cells) as f32]);
                let nearest = corners.map(|c| (c[0] - at[0]).hypot(c[1] - at[1])).into_iter().fold(9.0, f32::min);
                assert!(nearest < 0.18, "{turn:?}: {nearest}");
            }
        }
    }
}
