//! What the segmentation network sees in scans: its bottleneck, averaged over all rings and an eighth of a turn.

use anyhow::{Result, ensure};
use burn::tensor::{Device, Tensor};
use lidar::{RangeImage, Sensor};
use likeness::Features;

use crate::segmentation::Segmentation;
use crate::segmentation::darknet::COLUMN_MULTIPLE;

/// Samples that a scan gives: a turn of the sensor is cut in so many sectors.
pub const SECTORS: usize = 8;

/// The features of each scan: a sample a sector, as long as the bottleneck has channels.
pub fn of_scans(
    segmentation: &Segmentation,
    images: &[RangeImage],
    sensor: &Sensor,
    device: &Device,
) -> Result<Vec<Features>> {
    let (rings, known) = (sensor.rings().len(), segmentation.card.sensor.rings().len());
    ensure!(rings == known, "the sensor has {rings} rings, the segmentation network was trained on {known}");
    let multiple = SECTORS * COLUMN_MULTIPLE;
    ensure!(
        sensor.columns().is_multiple_of(multiple),
        "{} columns are no multiple of {multiple}, which the segmentation network's features take",
        sensor.columns()
    );
    Ok(images.iter().map(|image| sectors(segmentation.features(image, sensor, device))).collect())
}

/// Means over rings and the columns of each sector of `[channel, ring, column]`.
fn sectors(features: Tensor<3>) -> Features {
    let [channels, rings, columns] = features.dims();
    let width = columns / SECTORS;
    let by_sector = features.reshape([channels, rings, SECTORS, width]).mean_dim(3).mean_dim(1);
    let values: Vec<f64> = by_sector.into_data().iter::<f32>().map(f64::from).collect(); // [channel, 1, sector, 1]
    (0..SECTORS).map(|sector| (0..channels).map(|channel| values[channel * SECTORS + sector]).collect()).collect()
}

#[cfg(test)]
mod tests {
    use burn::tensor::TensorData;

    use super::*;

    #[test]
    fn a_sample_is_the_mean_of_its_sector_alone() {
        // Two channels, two rings, 16 columns: 100·channel + 10·ring + column.
        let value = |i: usize| (100 * (i / 32) + 10 * (i / 16 % 2) + i % 16) as f32;
        let features = Tensor::from_data(TensorData::new((0..64).map(value).collect(), [2, 2, 16]), &Device::flex());
        let samples = sectors(features);
        assert_eq!(samples.len(), SECTORS);
        // Columns 6 and 7 of both rings: 5 + 6.5.
        assert_eq!(samples[3], [11.5, 111.5]);
    }
}
