//! KITTI's `.bin`, and the same bytes from CARLA's `ray_cast` lidar: x, y, z, intensity, float32, nothing else.

use std::borrow::Cow;

use super::number::f32_column;
use super::{FormatError, Limits, input};
use crate::PointCloud;

const POINT_BYTES: usize = 16;

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<PointCloud, FormatError> {
    let records = input::whole_records(bytes, POINT_BYTES, "KITTI", limits)?;
    Ok(PointCloud {
        x: f32_column(records, POINT_BYTES, 0),
        y: f32_column(records, POINT_BYTES, 4),
        z: f32_column(records, POINT_BYTES, 8),
        intensity: f32_column(records, POINT_BYTES, 12),
        ..PointCloud::new(1.0)
    })
}

pub(super) fn encode(cloud: &PointCloud) -> Vec<u8> {
    let intensity = scaled_intensity(cloud, 1.0);
    let points = cloud.x.iter().zip(&cloud.y).zip(&cloud.z).zip(intensity.iter());
    let mut records = vec![0; cloud.len() * POINT_BYTES];
    for (record, (((x, y), z), intensity)) in records.chunks_exact_mut(POINT_BYTES).zip(points) {
        record.copy_from_slice([x, y, z, intensity].map(|value| value.to_le_bytes()).as_flattened());
    }
    records
}

/// The cloud's intensities with `full_scale` for a reflectance of 1; untouched where that is their scale already.
pub(super) fn scaled_intensity(cloud: &PointCloud, full_scale: f32) -> Cow<'_, [f32]> {
    if cloud.full_scale == full_scale {
        return Cow::Borrowed(&cloud.intensity);
    }
    cloud.intensity.iter().map(|intensity| intensity / cloud.full_scale * full_scale).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_of_eight_bits_is_written_from_zero_to_one() -> Result<(), FormatError> {
        let cloud =
            PointCloud { x: vec![1.0], y: vec![2.0], z: vec![3.0], intensity: vec![51.0], ..PointCloud::new(255.0) };
        assert_eq!(decode(&encode(&cloud), &Limits::default())?.intensity, [0.2]);
        Ok(())
    }
}
