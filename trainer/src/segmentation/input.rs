//! What the network sees of a scan.

use burn::tensor::{Device, Tensor, TensorData};
use lidar::{RangeImage, Sensor};

/// Channels of the input: log₂(range + 1) / 7, height above the sensor in units of [`HEIGHT_M`], reflectance, whether there is a return.
///
/// `RangeNet++` has x and y as well; without them, turning the sensor turns the answer.
pub const CHANNELS: usize = 4;

/// Height that counts as 1, in metres.
const HEIGHT_M: f64 = 4.0;

/// A scan as the network sees it, `[4, ring, column]`, row-major.
///
/// # Panics
/// If the image has another number of rings than the sensor.
pub fn channels(image: &RangeImage, sensor: &Sensor) -> Vec<f32> {
    assert_eq!(image.rings(), sensor.rings().len(), "an image of the sensor's rings");
    let pixels = image.range_m().len();
    let mut out = vec![0.0; CHANNELS * pixels];
    for (i, (range_m, reflectance)) in image.range_m().iter().zip(image.reflectance()).enumerate() {
        if *range_m > 0.0 {
            // The height does not depend on the column.
            let height_m = sensor.point_m(i / image.columns(), 0, f64::from(*range_m))[2];
            out[i] = (range_m + 1.0).log2() / 7.0;
            out[pixels + i] = (height_m / HEIGHT_M) as f32;
            out[2 * pixels + i] = *reflectance;
            out[3 * pixels + i] = 1.0;
        }
    }
    out
}

/// Scans of one size as one tensor, `[batch, 4, ring, column]`.
pub fn tensor<'a>(images: impl IntoIterator<Item = &'a RangeImage>, sensor: &Sensor, device: &Device) -> Tensor<4> {
    let mut size = [0, CHANNELS, 0, 0];
    let mut values = Vec::new();
    for image in images {
        values.extend(channels(image, sensor));
        (size[0], size[2], size[3]) = (size[0] + 1, image.rings(), image.columns());
    }
    Tensor::from_data(TensorData::new(values, size), device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_return_from_below_is_below_and_no_return_is_nothing() -> Result<(), Box<dyn std::error::Error>> {
        let sensor = Sensor::from_elevations_deg("two", [0.0, -30.0], 8, (0.5, 100.0), 10.0)?;
        let mut image = RangeImage::empty(2, 8);
        image.set(8 + 3, 8.0, 0.25, 0);
        let seen = channels(&image, &sensor);
        let at = |channel: usize| seen[16 * channel + 11];
        // 8 m at 30° below: 4 m down.
        assert!((at(0) - 9f32.log2() / 7.0).abs() < 1e-6 && (at(1) + 1.0).abs() < 1e-6);
        assert_eq!((at(2), at(3)), (0.25, 1.0));
        assert_eq!(seen.iter().filter(|x| **x != 0.0).count(), 4);
        Ok(())
    }
}
