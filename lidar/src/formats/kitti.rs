//! KITTI's `.bin`, and the same bytes from CARLA's `ray_cast` lidar: x, y, z, intensity, float32, nothing else.

#![allow(
    clippy::inline_always,
    reason = "a loop is compiled for the processor at hand only where all of it is inlined"
)]

use std::borrow::Cow;

use pulp::Arch;

use super::{FormatError, Limits, input};
use crate::PointCloud;

const POINT_BYTES: usize = 16;

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<PointCloud, FormatError> {
    let (records, _) = input::whole_records(bytes, POINT_BYTES, "KITTI", limits)?.as_chunks::<POINT_BYTES>();
    let column = || vec![0.0; records.len()];
    let (mut x, mut y, mut z, mut intensity) = (column(), column(), column(), column());
    let columns = x.iter_mut().zip(&mut y).zip(&mut z).zip(&mut intensity);
    // All columns in one pass: the processor loads a record once, and takes it apart many at a time.
    Arch::new().dispatch(
        #[inline(always)]
        || {
            for ((((x, y), z), intensity), record) in columns.zip(records) {
                let number = |i: usize| f32::from_le_bytes([record[i], record[i + 1], record[i + 2], record[i + 3]]);
                (*x, *y, *z, *intensity) = (number(0), number(4), number(8), number(12));
            }
        },
    );
    Ok(PointCloud { x, y, z, intensity, ..PointCloud::new(1.0) })
}

pub(super) fn encode(cloud: &PointCloud) -> Vec<u8> {
    let intensity = scaled_intensity(cloud, 1.0);
    let points = cloud.x.iter().zip(&cloud.y).zip(&cloud.z).zip(intensity.iter());
    let records: Vec<[[u8; 4]; 4]> =
        points.map(|(((x, y), z), intensity)| [x, y, z, intensity].map(|value| value.to_le_bytes())).collect();
    records.into_flattened().into_flattened()
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
