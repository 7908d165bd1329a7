//! KITTI's `.bin`, and the same bytes from CARLA's `ray_cast` lidar: x, y, z, intensity, float32, nothing else.

use super::number::{Numbers, f32_column};
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
    let mut records = vec![0; cloud.len() * POINT_BYTES];
    for (column, offset) in [(&cloud.x, 0), (&cloud.y, 4), (&cloud.z, 8)] {
        Numbers::F32(column.into()).write(&mut records, POINT_BYTES, offset);
    }
    Numbers::F32(scaled_intensity(cloud, 1.0).into()).write(&mut records, POINT_BYTES, 12);
    records
}

/// The cloud's intensities with `full_scale` for a reflectance of 1; untouched where that is their scale already.
pub(super) fn scaled_intensity(cloud: &PointCloud, full_scale: f32) -> Vec<f32> {
    if cloud.full_scale == full_scale {
        return cloud.intensity.clone();
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
