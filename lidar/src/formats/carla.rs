//! CARLA's semantic lidar: float32 x, y, z, cosine of the incidence angle, uint32 object, uint32 tag.
//!
//! CARLA documentation, "Sensors reference", semantic lidar, `raw_data`. The sensor measures no intensity: it stays zero.

use super::number::{Endian, Lane, NumberType, Numbers, column, f32_column};
use super::{FormatError, Limits, input};
use crate::PointCloud;
use crate::cloud::{Column, Values};
use crate::label::{CarlaTags, class_of};

const POINT_BYTES: usize = 24;

/// CARLA's own names for its fields, as in the PLY files that it saves.
const COS_ANGLE: &str = "CosAngle";
const OBJECT: &str = "ObjIdx";
const TAG: &str = "ObjTag";

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<PointCloud, FormatError> {
    let records = input::whole_records(bytes, POINT_BYTES, "CARLA semantic", limits)?;
    let points = records.len() / POINT_BYTES;
    let extra = |name: &str, number_type, offset| {
        let lane = Lane { stride: POINT_BYTES, offset, endian: Endian::Little };
        Column { name: name.into(), values: column(number_type, records, lane) }
    };
    let mut cloud = PointCloud {
        x: f32_column(records, POINT_BYTES, 0),
        y: f32_column(records, POINT_BYTES, 4),
        z: f32_column(records, POINT_BYTES, 8),
        intensity: vec![0.0; points],
        extra: vec![
            extra(COS_ANGLE, NumberType::F32, 12),
            extra(OBJECT, NumberType::U32, 16),
            extra(TAG, NumberType::U32, 20),
        ],
        ..PointCloud::new(1.0)
    };
    label_by_tag(&mut cloud, limits.carla_tags);
    Ok(cloud)
}

/// Gives a cloud without labels the ones that CARLA's tags mean, where it has tags. The object becomes the instance.
pub(super) fn label_by_tag(cloud: &mut PointCloud, tags: CarlaTags) {
    let (None, Some(tag)) = (&cloud.label, u32_extra(cloud, TAG)) else { return };
    let object = u32_extra(cloud, OBJECT);
    let label = |i: usize, tag: u32| tags.to_label(tag) | (object.map_or(0, |object| object[i]) << 16);
    cloud.label = Some(tag.iter().enumerate().map(|(i, &tag)| label(i, tag)).collect());
}

pub(super) fn encode(cloud: &PointCloud) -> Vec<u8> {
    let mut records = vec![0; cloud.len() * POINT_BYTES];
    for (column, offset) in [(&cloud.x, 0), (&cloud.y, 4), (&cloud.z, 8)] {
        Numbers::F32(column.into()).write(&mut records, POINT_BYTES, offset);
    }
    if let Some(Values::F32(cosine)) = cloud.extra.iter().find(|c| c.name == COS_ANGLE).map(|c| &c.values) {
        Numbers::F32(cosine.into()).write(&mut records, POINT_BYTES, 12);
    }
    let labels = cloud.label.as_deref().unwrap_or_default();
    let object =
        u32_extra(cloud, OBJECT).map_or_else(|| labels.iter().map(|label| label >> 16).collect(), <[u32]>::to_vec);
    let tag =
        u32_extra(cloud, TAG).map_or_else(|| labels.iter().map(|&label| tag_of(label)).collect(), <[u32]>::to_vec);
    Numbers::U32(object.into()).write(&mut records, POINT_BYTES, 16);
    Numbers::U32(tag.into()).write(&mut records, POINT_BYTES, 20);
    records
}

fn u32_extra<'a>(cloud: &'a PointCloud, name: &str) -> Option<&'a [u32]> {
    match &cloud.extra.iter().find(|column| column.name == name)?.values {
        Values::U32(values) => Some(values),
        _ => None,
    }
}

/// The first of CARLA's tags (since 0.9.14) whose class is the label's; 0 where there is none.
fn tag_of(label: u32) -> u32 {
    const TAGS: u32 = 29;
    let tags = CarlaTags::Since0914;
    let same_id = (0..TAGS).find(|&tag| tags.to_label(tag) == label & 0xffff);
    let class = class_of(label);
    same_id.or_else(|| (1..TAGS).find(|&tag| class != 0 && class_of(tags.to_label(tag)) == class)).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_become_tags_of_the_same_class_and_objects_their_instance() -> Result<(), FormatError> {
        let labels = vec![40, 0x0009_000a, 252, 70, 0];
        let zeros = vec![0.0; labels.len()];
        let cloud = PointCloud {
            x: zeros.clone(),
            y: zeros.clone(),
            z: zeros.clone(),
            intensity: zeros,
            label: Some(labels),
            ..PointCloud::new(1.0)
        };
        let read = decode(&encode(&cloud), &Limits::default())?;
        assert_eq!(read.label, Some(vec![40, 0x0009_000a, 10, 70, 0]));
        Ok(())
    }

    #[test]
    fn tags_objects_and_cosines_survive_as_they_are() -> Result<(), FormatError> {
        let bytes: Vec<u8> = (0..48).map(|i| i * 5).collect();
        assert_eq!(encode(&decode(&bytes, &Limits::default())?), bytes);
        Ok(())
    }
}
