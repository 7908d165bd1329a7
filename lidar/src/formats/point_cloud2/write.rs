//! Messages from clouds.

use super::FormatError;
use super::cdr::Writer;
use super::message::{self, PointField, RosMessage, Stamp};
use crate::PointCloud;
use crate::formats::meaning;
use crate::formats::number::{Endian, Lane, Numbers};
use crate::formats::record::{self, Field, Written};

/// Points begin at multiples of this in messages of our own.
const POINT_ALIGNMENT: usize = 4;

/// Writes a cloud as a message of the layout that it came in, or else of our own.
pub(crate) fn encode(cloud: &PointCloud) -> Result<Vec<u8>, FormatError> {
    let Some(message) = cloud.ros.as_deref().filter(|message| !message.fields.is_empty()) else {
        let (message, columns) = natural(cloud);
        return serialise(cloud, &message, &columns);
    };
    let columns: Vec<_> = message.fields.iter().flat_map(|field| columns_of(cloud, field)).collect();
    serialise(cloud, message, &columns)
}

/// A column and its place in the point.
struct Placed<'a> {
    numbers: Numbers<'a>,
    offset: usize,
}

fn serialise(cloud: &PointCloud, message: &RosMessage, columns: &[Placed<'_>]) -> Result<Vec<u8>, FormatError> {
    let points = cloud.len();
    let bytes = points.saturating_mul(message.point_step);
    let too_many =
        |found: String| FormatError::TooMany { field: "data".into(), offset: 0, found, limit: u32::MAX as usize };
    let data_length = u32::try_from(bytes).map_err(|_| too_many(format!("{bytes} bytes")))?;
    let width = u32::try_from(points).map_err(|_| too_many(format!("{points} points")))?;

    let mut writer = Writer::new(message.endian, bytes + 1024);
    writer.u32(message.stamp.seconds);
    writer.u32(message.stamp.nanoseconds);
    writer.string(&message.frame_id);
    writer.u32(1);
    writer.u32(width);
    writer.u32(message.fields.len() as u32);
    for field in &message.fields {
        writer.string(&field.field.name);
        writer.u32(field.offset as u32);
        writer.u8(message::datatype(field.field.number_type).unwrap_or_default());
        writer.u32(field.stated_count);
    }
    writer.u8(u8::from(message.data_endian == Endian::Big));
    writer.u32(message.point_step as u32);
    writer.u32(data_length);
    writer.u32(data_length);
    let records = writer.zeros(bytes);
    for column in columns {
        let lane = Lane { stride: message.point_step, offset: column.offset, endian: message.data_endian };
        column.numbers.write_lane(records, lane);
    }
    let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
    writer.u8(u8::from(finite(&cloud.x) && finite(&cloud.y) && finite(&cloud.z)));
    Ok(writer.into_bytes())
}

/// A layout for a cloud from elsewhere, and the columns at their places.
fn natural(cloud: &PointCloud) -> (RosMessage, Vec<Placed<'_>>) {
    let (mut fields, mut columns, mut end) = (Vec::new(), Vec::new(), 0_usize);
    for mut column in record::written(cloud) {
        record::without_64_bit_integers(&mut column);
        let Written { name, numbers } = column;
        let number_type = numbers.number_type();
        let offset = end.next_multiple_of(number_type.bytes());
        end = offset + number_type.bytes();
        let field = Field { name: name.into_owned(), number_type, count: 1 };
        fields.push(PointField { field, offset, stated_count: 1 });
        columns.push(Placed { numbers, offset });
    }
    let source = cloud.ros.as_deref();
    let message = RosMessage {
        stamp: source.map_or_else(Stamp::default, |source| source.stamp),
        frame_id: source.map_or_else(String::new, |source| source.frame_id.clone()),
        fields,
        point_step: end.next_multiple_of(POINT_ALIGNMENT),
        data_endian: Endian::Little,
        endian: Endian::Little,
    };
    (message, columns)
}

/// What a cloud has for the field of a message, in the field's type: columns that were carried along as they are, others under the name
/// that reading took them by. Bytes without a meaning stay zero.
fn columns_of<'a>(cloud: &'a PointCloud, field: &PointField) -> Vec<Placed<'a>> {
    if field.is_padding() {
        return Vec::new();
    }
    let number_type = field.field.number_type;
    let place = |i: usize| {
        let name = record::column_name(&field.field, i);
        let carried = cloud.extra.iter().find(|column| column.name == name).map(|column| Numbers::from(&column.values));
        let numbers = carried.or_else(|| meaning::named(cloud, &name, number_type))?;
        let offset = field.offset + i * number_type.bytes();
        Some(Placed { numbers: numbers.converted(number_type), offset })
    };
    (0..field.field.count).filter_map(place).collect()
}
