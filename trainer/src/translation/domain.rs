//! The scans of one domain, simulated or real, on one sensor's grid.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use burn::tensor::Device;
use lidar::{RangeImage, Sensor};
use proto::card::Dataset;

use super::config::TranslationConfig;
use crate::config::DataConfig;
use crate::data::Scans;
use crate::data::sample::SimulatedReflectance;
use crate::segmentation::Segmentation;

/// Least share of the sensor's rings that a scan of it fills; one of a sensor with half as many rings does not.
const LEAST_RINGS: f64 = 0.7;

/// Rays that point down by more than this meet the ground within some metres, if nothing is in their way.
const SURELY_DOWN_RAD: f64 = -10.0 * std::f64::consts::PI / 180.0;

/// Share of the scans in which a ray that meets the sensor's own vehicle is reported, at most: what is reported of it are exceptions.
const OWN_VEHICLE_SHARE: f64 = 0.1;

/// Scans that it takes at least to tell what never returns from what did not happen to.
const OWN_VEHICLE_SCANS: usize = 10;

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
        Self::labelled(root, list, grid, None)
    }

    /// A config's real scans, labelled where it says by whom.
    pub fn real(config: &TranslationConfig, data: &Path, list: &[DataConfig]) -> Result<Self> {
        let labeller =
            config.labeller.as_ref().map(|folder| Segmentation::load(folder, &Device::flex())).transpose()?;
        Self::labelled(data, list, &config.grid()?, labeller.as_ref())
    }

    fn labelled(root: &Path, list: &[DataConfig], grid: &Grid, labeller: Option<&Segmentation>) -> Result<Self> {
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
                let image = match labeller {
                    Some(labeller) => labeller.labelled(&image, &grid.native, &Device::flex()),
                    None => image,
                };
                domain.images.push(on_grid(image, grid).with_context(|| path.to_string())?);
            }
            domain.datasets.push(scans.dataset);
        }
        Ok(domain)
    }

    /// Numbers of the pixels whose rays are lost to the vehicle that carries the sensor: they point at the ground beside it, and hardly any
    /// scan reports them. None where there are few scans.
    pub fn own_vehicle(&self, sensor: &Sensor) -> Vec<usize> {
        let most = (OWN_VEHICLE_SHARE * self.images.len() as f64) as usize;
        let reported = |i: usize| self.images.iter().filter(|image| image.range_m()[i] > 0.0).count();
        let down = |ring: usize| sensor.rings()[ring].elevation_rad < SURELY_DOWN_RAD;
        let lost = |i: &usize| down(i / sensor.columns()) && reported(*i) <= most;
        if self.images.len() < OWN_VEHICLE_SCANS { vec![] } else { (0..sensor.pixels()).filter(lost).collect() }
    }

    /// What of a config's simulated scans has to be left out to compare them with these real ones: the pixels that the vehicle hides, where
    /// the config asks for it.
    pub fn hidden(&self, config: &TranslationConfig, sensor: &Sensor) -> Vec<usize> {
        if config.own_vehicle { self.own_vehicle(sensor) } else { vec![] }
    }

    /// The same scans without the returns of these pixels.
    #[must_use]
    pub fn without(mut self, pixels: &[usize]) -> Self {
        for image in &mut self.images {
            for i in pixels {
                image.remove(*i);
            }
        }
        self
    }

    /// The same scans with the reflectance e^(−a r), in place of their own.
    #[must_use]
    pub fn attenuated(mut self, rate_per_m: f32) -> Self {
        for image in &mut self.images {
            let reflectance = SimulatedReflectance::Attenuation(rate_per_m).of(image);
            let (range_m, class) = (image.range_m().to_vec(), image.class().to_vec());
            *image = RangeImage::from_channels(image.columns(), range_m, reflectance, class);
        }
        self
    }

    /// Scans of a config's simulation, as they are compared with `real` ones: where the config asks for it, with the reflectance of a
    /// simulator that knows no surfaces, and without the rays that the real ones lose to the vehicle that carries the sensor.
    pub fn simulated(config: &TranslationConfig, data: &Path, list: &[DataConfig], real: &Self) -> Result<Self> {
        let grid = config.grid()?;
        let mut domain = Self::load(data, list, &grid)?;
        if let Some(rate_per_m) = config.attenuation_per_m {
            domain = domain.attenuated(rate_per_m as f32);
        }
        Ok(domain.without(&real.hidden(config, &grid.sensor)))
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
    use crate::segmentation::DarknetConfig;
    use crate::segmentation::weights::SegmentationCard;

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
    fn what_no_scan_reports_of_the_ground_beside_it_is_the_own_vehicle() -> Result<()> {
        let sensor = grid(false)?.sensor;
        // Ring 0 points up, ring 15 down; chance takes other pixels from scan to scan.
        let scan = |n: usize| {
            let mut scan = image(32);
            for i in [3, 15 * 32 + 3, 15 * 32 + 4, 14 * 32 + n] {
                scan.remove(i);
            }
            scan
        };
        let domain = |scans: usize| Domain { images: (0..scans).map(scan).collect(), datasets: vec![] };
        let lost = domain(12).own_vehicle(&sensor);
        assert_eq!(lost, [15 * 32 + 3, 15 * 32 + 4]);
        assert!(domain(9).own_vehicle(&sensor).is_empty(), "too few to tell");
        let other = Domain { images: vec![image(32)], datasets: vec![] }.without(&lost);
        assert_eq!(other.images[0].returns(), 16 * 32 - 2);
        Ok(())
    }

    #[test]
    fn a_labellers_classes_stay_with_the_returns_on_a_coarser_grid() -> Result<()> {
        let (folder, native) = (tempfile::tempdir()?, Sensor::builtin("vlp16")?.with_columns(64)?);
        let range_m = (0..16 * 64).map(|i| 2.0 + (i % 37) as f32).collect();
        let scan = RangeImage::from_channels(64, range_m, vec![0.5; 16 * 64], vec![0; 16 * 64]);
        lidar::formats::write(&folder.path().join("scan.ply"), &scan.to_cloud(&native))?;
        let data = [DataConfig {
            path: "scan.ply".into(),
            source: "made up".into(),
            licence: "MIT".into(),
            columns: None,
            drops_observed: true,
            sector_deg: None,
        }];
        let device = Device::flex();
        device.seed(5);
        let size = DarknetConfig { channels: [2, 2, 4, 4, 4] };
        let card = SegmentationCard::new("A test", "MIT", "", native.clone(), size.clone());
        let labeller = Segmentation { network: size.init(&device), card };
        let load = |columns: usize, labeller| -> Result<RangeImage> {
            let grid = Grid { sensor: native.clone().with_columns(columns)?, native: native.clone(), resample: true };
            Ok(Domain::labelled(folder.path(), &data, &grid, labeller)?.images.remove(0))
        };
        assert!(load(32, None)?.class().iter().all(|class| *class == 0));
        let fine = load(64, Some(&labeller))?;
        assert!(fine.class().iter().all(|class| *class > 0));
        assert_eq!(load(32, Some(&labeller))?, fine.pick_columns(32));
        Ok(())
    }

    #[test]
    fn attenuated_scans_have_the_reflectance_of_their_ranges() {
        let range_m = (0..32).map(|i| i as f32).collect();
        let image = RangeImage::from_channels(8, range_m, vec![0.3; 32], vec![2; 32]);
        let domain = Domain { images: vec![image.clone()], datasets: vec![] }.attenuated(0.1);
        let attenuated = &domain.images[0];
        assert_eq!((attenuated.range_m(), attenuated.class()), (image.range_m(), image.class()));
        assert_eq!(attenuated.reflectance()[0], image.reflectance()[0], "no return");
        assert!((attenuated.reflectance()[10] - (-1.0_f32).exp()).abs() < 1e-6);
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
