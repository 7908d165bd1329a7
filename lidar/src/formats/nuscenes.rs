//! nuScenes' `.pcd.bin`: x, y, z, intensity from 0 to 255, ring, all float32.

use super::kitti::scaled_intensity;
use super::number::{Numbers, f32_column};
use super::{FormatError, Limits, input};
use crate::PointCloud;
use crate::cloud::{Column, Values};

const POINT_BYTES: usize = 20;

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<PointCloud, FormatError> {
    let records = input::whole_records(bytes, POINT_BYTES, "nuScenes", limits)?;
    let mut cloud = PointCloud {
        x: f32_column(records, POINT_BYTES, 0),
        y: f32_column(records, POINT_BYTES, 4),
        z: f32_column(records, POINT_BYTES, 8),
        intensity: f32_column(records, POINT_BYTES, 12),
        ..PointCloud::new(255.0)
    };
    let ring = f32_column(records, POINT_BYTES, 16);
    if ring.iter().all(|&ring| ring == f32::from(ring as u16)) {
        cloud.ring = Some(ring.into_iter().map(|ring| ring as u16).collect());
    } else if ring.iter().any(|&ring| ring != NO_RING) {
        // Some tools put the sweep's age here: whatever it is, it is no ring.
        cloud.extra.push(Column { name: FIFTH.into(), values: Values::F32(ring) });
    }
    Ok(cloud)
}

/// Name of the fifth number where it is no ring.
const FIFTH: &str = "column_4";

/// What we write for a cloud without rings: a row of zeros would put all its points on one laser.
const NO_RING: f32 = -1.0;

pub(super) fn encode(cloud: &PointCloud) -> Vec<u8> {
    let mut records = vec![0; cloud.len() * POINT_BYTES];
    for (column, offset) in [(&cloud.x, 0), (&cloud.y, 4), (&cloud.z, 8)] {
        Numbers::F32(column.into()).write(&mut records, POINT_BYTES, offset);
    }
    Numbers::F32(scaled_intensity(cloud, 255.0)).write(&mut records, POINT_BYTES, 12);
    let fifth = match (&cloud.ring, cloud.extra.iter().find(|column| column.name == FIFTH)) {
        (Some(ring), _) => ring.iter().map(|&ring| f32::from(ring)).collect(),
        (None, Some(Column { values: Values::F32(values), .. })) => values.clone(),
        (None, _) => vec![NO_RING; cloud.len()],
    };
    Numbers::F32(fifth.into()).write(&mut records, POINT_BYTES, 16);
    records
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud() -> PointCloud {
        PointCloud { x: vec![1.0], y: vec![2.0], z: vec![3.0], intensity: vec![0.2], ..PointCloud::new(1.0) }
    }

    #[test]
    fn a_ring_survives_and_a_missing_one_stays_missing() -> Result<(), FormatError> {
        let with_ring = PointCloud { ring: Some(vec![31]), ..cloud() };
        assert_eq!(decode(&encode(&with_ring), &Limits::default())?.ring, Some(vec![31]));
        let without = decode(&encode(&cloud()), &Limits::default())?;
        assert_eq!((without.ring, without.extra.len()), (None, 0));
        assert_eq!(without.intensity, [51.0]);
        Ok(())
    }

    #[test]
    fn a_fifth_number_that_is_no_ring_is_carried_as_it_is() -> Result<(), FormatError> {
        let mut bytes = encode(&cloud());
        bytes[16..].copy_from_slice(&0.05_f32.to_le_bytes());
        let cloud = decode(&bytes, &Limits::default())?;
        assert_eq!((cloud.ring.is_none(), encode(&cloud)), (true, bytes));
        Ok(())
    }
}
