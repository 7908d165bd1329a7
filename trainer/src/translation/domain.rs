//! The scans of one domain, simulated or real, on one sensor's grid.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use lidar::{RangeImage, Sensor};
use proto::card::Dataset;

use crate::config::DataConfig;
use crate::data::Scans;

/// Least share of the sensor's rings that a scan of it fills; one of a sensor with half as many rings does not.
const LEAST_RINGS: f64 = 0.7;

/// Scans that are alike in origin.
#[derive(Clone, Debug, Default)]
pub struct Domain {
    /// Range images of one size.
    pub images: Vec<RangeImage>,
    /// For the model card.
    pub datasets: Vec<Dataset>,
}

/// The grid that every scan of both domains is brought to.
#[derive(Clone, Debug)]
pub struct Grid {
    /// The sensor that is imitated, with the grid's columns.
    pub sensor: Sensor,
    /// The sensor with its own columns, which scans are projected to first.
    pub native: Sensor,
    /// Whether scans with more columns may be brought to the grid's: only where a config names its columns.
    pub resample: bool,
}

impl Domain {
    /// Reads folders of scans, each of any format.
    ///
    /// A scan of a sensor with clearly fewer rings is refused, and so are folders with other columns than the grid's, unless the grid
    /// allows that they are resampled to its own. A pixel of the grid then shows the ray in its middle, reported or lost: were it the
    /// nearest return of all that it covers, hardly a ray would be lost.
    pub fn load(root: &Path, list: &[DataConfig], grid: &Grid) -> Result<Self> {
        let mut domain = Self::default();
        for data in list {
            let scans = Scans::load(root, data, &grid.native)?;
            let path = data.path.display();
            for image in scans.images {
                let (filled, rings) = (rings_filled(&image), image.rings());
                ensure!(
                    filled as f64 >= LEAST_RINGS * rings as f64,
                    "{path}: a scan fills {filled} of the {rings} rings of {}: scans of another sensor",
                    grid.sensor.name
                );
                domain.images.push(on_grid(image, grid).with_context(|| path.to_string())?);
            }
            domain.datasets.push(scans.dataset);
        }
        Ok(domain)
    }
}

fn rings_filled(image: &RangeImage) -> usize {
    image.range_m().chunks(image.columns()).filter(|row| row.iter().any(|r| *r > 0.0)).count()
}

fn on_grid(image: RangeImage, grid: &Grid) -> Result<RangeImage> {
    let (from, to) = (image.columns(), grid.sensor.columns());
    if from == to {
        return Ok(image);
    }
    ensure!(grid.resample, "{from} columns beside {to}: mixed sensors; give the config its `columns` to resample to");
    ensure!(from > to, "{from} columns are fewer than the {to} that the config asks for");
    Ok(image.pick_columns(to))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(resample: bool) -> Result<Grid> {
        let sensor = Sensor::builtin("vlp16")?.with_columns(32)?;
        Ok(Grid { native: sensor.clone(), sensor, resample })
    }

    fn image(columns: usize) -> RangeImage {
        let pixels = 16 * columns;
        RangeImage::from_channels(columns, vec![5.0; pixels], vec![0.5; pixels], vec![0; pixels])
    }

    #[test]
    fn mixed_columns_are_refused_unless_the_config_names_its_own() -> Result<()> {
        assert!(on_grid(image(64), &grid(false)?).is_err_and(|e| e.to_string().contains("mixed sensors")));
        assert_eq!(on_grid(image(64), &grid(true)?)?.columns(), 32);
        assert!(on_grid(image(16), &grid(true)?).is_err_and(|e| e.to_string().contains("fewer")));
        assert_eq!(on_grid(image(32), &grid(false)?)?, image(32));
        Ok(())
    }

    #[test]
    fn a_scan_of_half_the_rings_is_another_sensors() -> Result<()> {
        let folder = tempfile::tempdir()?;
        let sensor = Sensor::builtin("vlp16")?.with_columns(32)?;
        let mut half = image(32);
        (0..8 * 32).for_each(|i| half.remove(2 * (i / 32) * 32 + i % 32));
        let data = |name: &str| DataConfig {
            path: name.into(),
            source: "made up".into(),
            licence: "MIT".into(),
            columns: None,
            drops_observed: true,
            sector_deg: None,
        };
        lidar::formats::write(&folder.path().join("whole.ply"), &image(32).to_cloud(&sensor))?;
        lidar::formats::write(&folder.path().join("half.ply"), &half.to_cloud(&sensor))?;
        let load = |name: &str| Domain::load(folder.path(), &[data(name)], &grid(false)?);
        assert_eq!(load("whole.ply")?.images[0].returns(), 16 * 32);
        assert!(load("half.ply").is_err_and(|e| e.to_string().contains("another sensor")));
        Ok(())
    }
}
