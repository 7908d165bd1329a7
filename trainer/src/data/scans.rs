//! Real scans as range images, from folders of files of any format.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use lidar::formats::{self, Format, Limits};
use lidar::label::CLASSES;
use lidar::{Projector, RangeImage, Sensor};
use proto::card::Dataset;
use sha2::{Digest, Sha256};

use crate::config::DataConfig;
use crate::network::COLUMN_MULTIPLE;

/// The scans of one [`DataConfig`], cut to its sector.
#[derive(Clone, Debug)]
pub struct Scans {
    /// The range images, in the order of their files' names.
    pub images: Vec<RangeImage>,
    /// See [`DataConfig::drops_observed`].
    pub drops_observed: bool,
    /// For the model card.
    pub dataset: Dataset,
}

impl Scans {
    /// Reads every scan of a folder and projects it to the sensor.
    pub fn load(root: &Path, config: &DataConfig, sensor: &Sensor) -> Result<Self> {
        let sensor = match config.columns {
            Some(columns) => sensor.clone().with_columns(columns)?,
            None => sensor.clone(),
        };
        let path = root.join(&config.path);
        let files = scan_files(&path)?;
        let mut projector = Projector::new(&sensor);
        let mut digest = Sha256::new();
        let mut images = Vec::with_capacity(files.len());
        let (mut lost, mut points) = (0, 0);
        for file in &files {
            digest.update(Sha256::digest(
                std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?,
            ));
            let cloud = formats::read(file, &Limits::default()).with_context(|| format!("scan {}", file.display()))?;
            let projection = projector.project(&cloud).with_context(|| format!("scan {}", file.display()))?;
            lost += projection.report.lost;
            points += projection.report.points_in;
            images.push(match config.sector_deg {
                Some(sector) => cut_sector(&projection.image, sector)?,
                None => projection.image,
            });
        }
        tracing::info!(
            path = %path.display(),
            scans = images.len(),
            "read; {:.1} % of the points lost their pixel to a nearer one",
            100.0 * lost as f64 / points.max(1) as f64
        );
        let dataset = Dataset {
            name: config.source.clone(),
            licence: config.licence.clone(),
            scans: images.len(),
            sha256: hex(&digest.finalize()),
        };
        Ok(Self { images, drops_observed: config.drops_observed, dataset })
    }
}

/// Which classes occur in any of these scans; "unlabelled" always does.
pub fn classes_seen<'a>(scans: impl IntoIterator<Item = &'a Scans>) -> [bool; CLASSES] {
    let mut seen = [false; CLASSES];
    seen[0] = true;
    for class in scans.into_iter().flat_map(|s| &s.images).flat_map(RangeImage::class) {
        seen[usize::from(*class)] = true;
    }
    seen
}

/// The scan files of a folder, or the file itself, in the order of their names.
pub fn scan_files(path: &Path) -> Result<Vec<PathBuf>> {
    if path.is_file() {
        return Ok(vec![path.to_owned()]);
    }
    let entries = std::fs::read_dir(path).with_context(|| format!("cannot read folder {}", path.display()))?;
    let mut files = Vec::new();
    for entry in entries {
        let file = entry?.path();
        if file.is_file() && Format::from_path(&file).is_some() {
            files.push(file);
        }
    }
    if files.is_empty() {
        bail!("no scan in {}", path.display());
    }
    files.sort();
    Ok(files)
}

/// The columns of a sector from one azimuth clockwise to another, in degrees; as many whole [`COLUMN_MULTIPLE`]s as fit.
fn cut_sector(image: &RangeImage, [from_deg, to_deg]: [f64; 2]) -> Result<RangeImage> {
    ensure!(
        (-180.0..=180.0).contains(&to_deg) && from_deg <= 180.0 && from_deg > to_deg,
        "sector_deg is [{from_deg}, {to_deg}], expected 180 ≥ from > to ≥ −180"
    );
    let column = |azimuth_deg: f64| ((180.0 - azimuth_deg) / 360.0 * image.columns() as f64).round() as usize;
    let (from, to) = (column(from_deg), column(to_deg));
    let count = (to - from) / COLUMN_MULTIPLE * COLUMN_MULTIPLE;
    ensure!(count > 0, "sector_deg [{from_deg}, {to_deg}] is narrower than {COLUMN_MULTIPLE} columns");
    Ok(cut_columns(image, from, count))
}

/// `count` columns from `from` on, round the turn.
pub fn cut_columns(image: &RangeImage, from: usize, count: usize) -> RangeImage {
    let columns = image.columns();
    let mut out = RangeImage::empty(image.rings(), count);
    for ring in 0..image.rings() {
        for column in 0..count {
            let i = ring * columns + (from + column) % columns;
            if image.range_m()[i] > 0.0 {
                out.set(ring * count + column, image.range_m()[i], image.reflectance()[i], image.class()[i]);
            }
        }
    }
    out
}

/// Lower-case hexadecimal.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        // Writing into a string cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sector_is_as_wide_as_the_network_takes() -> Result<()> {
        let image =
            RangeImage::from_channels(360, (0..360).map(|c| 1.0 + c as f32).collect(), vec![0.0; 360], vec![0; 360]);
        let sector = cut_sector(&image, [90.0, 45.0])?;
        assert_eq!(sector.columns(), 40);
        assert_eq!(sector.range_m()[0], 91.0, "column 90 of 360 looks 90° to the left");
        assert!(cut_sector(&image, [0.0, 90.0]).is_err(), "clockwise");
        assert!(cut_sector(&image, [1.0, 0.0]).is_err(), "too narrow");
        Ok(())
    }

    #[test]
    fn cutting_goes_round_the_turn() {
        let image = RangeImage::from_channels(4, vec![1.0, 2.0, 3.0, 4.0], vec![0.0; 4], vec![0; 4]);
        assert_eq!(cut_columns(&image, 3, 2).range_m(), [4.0, 1.0]);
    }
}
