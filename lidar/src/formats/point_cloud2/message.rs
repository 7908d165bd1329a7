//! What a message says besides its points, so that the answer to it is a message of the same kind.

use std::collections::HashSet;

use super::FormatError;
use super::cdr::Reader;
use crate::formats::number::{Endian, NumberType};
use crate::formats::record::{self, Field};

/// A ROS message without its points: when and in which coordinate frame it was measured, and how it lays out a point.
///
/// A cloud that came in a message keeps this, and is written as a message of the same layout, down to the names and types of fields.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RosMessage {
    pub(super) stamp: Stamp,
    pub(super) frame_id: String,
    pub(super) fields: Vec<PointField>,
    pub(super) point_step: usize,
    /// Byte order of the points.
    pub(super) data_endian: Endian,
    /// Byte order of everything else.
    pub(super) endian: Endian,
}

/// ROS' time: seconds and nanoseconds since 1970.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Stamp {
    pub(super) seconds: u32,
    pub(super) nanoseconds: u32,
}

/// One field of a point.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct PointField {
    /// Name, type and number of its values.
    pub(super) field: Field,
    /// Bytes from the point's start.
    pub(super) offset: usize,
    /// The count as it is in the message: old writers say 0 and mean 1.
    pub(super) stated_count: u32,
}

/// Most bytes of a point. Real ones have under a hundred.
const MAX_POINT_BYTES: usize = 512;
/// Fewest bytes of a field in a message: an empty name, offset, type, count.
const LEAST_FIELD_BYTES: usize = 16;

impl RosMessage {
    /// The coordinate frame's name.
    pub fn frame_id(&self) -> &str {
        &self.frame_id
    }

    /// Seconds and nanoseconds since 1970.
    pub fn stamp(&self) -> (i32, u32) {
        (self.stamp.seconds.cast_signed(), self.stamp.nanoseconds)
    }
}

/// Reads the list of fields.
pub(super) fn read_fields(reader: &mut Reader<'_>) -> Result<Vec<PointField>, FormatError> {
    let count = reader.u32("fields")? as usize;
    let offset = reader.position();
    let limit = reader.left() / LEAST_FIELD_BYTES;
    if count > limit {
        return Err(FormatError::TooMany { field: "fields".into(), offset, found: count.to_string(), limit });
    }
    let mut fields: Vec<PointField> = Vec::with_capacity(count);
    for _ in 0..count {
        fields.push(PointField::read(reader)?);
    }
    let all: Vec<Field> = fields.iter().map(|field| field.field.clone()).collect();
    record::record_bytes(&all, "fields", offset)?;
    let mut names = HashSet::new();
    for field in fields.iter().filter(|field| !field.is_padding()) {
        for i in 0..field.field.count {
            let name = record::column_name(&field.field, i);
            if !names.insert(name.clone()) {
                return Err(FormatError::field("fields", offset, "each name once", format!("`{name}` twice")));
            }
        }
    }
    Ok(fields)
}

/// Checks that the fields lie within `point_step` bytes, beside each other: overlapping ones would be more columns than bytes.
pub(super) fn check_layout(fields: &[PointField], point_step: usize, offset: usize) -> Result<(), FormatError> {
    if point_step > MAX_POINT_BYTES {
        let found = format!("{point_step} bytes");
        return Err(FormatError::TooMany { field: "point_step".into(), offset, found, limit: MAX_POINT_BYTES });
    }
    let mut spans: Vec<_> = fields.iter().map(|f| (f.offset, f.offset.saturating_add(f.field.bytes()), f)).collect();
    spans.sort_by_key(|(start, end, _)| (*start, *end));
    let mut taken = 0;
    for (start, end, field) in spans {
        let span = || format!("bytes {start} to {end} for `{}`", field.field.name);
        if end > point_step {
            return Err(FormatError::field(
                "fields",
                offset,
                format!("within point_step = {point_step} bytes"),
                span(),
            ));
        }
        if start < taken {
            return Err(FormatError::field("fields", offset, format!("nothing before byte {taken} twice"), span()));
        }
        taken = end;
    }
    Ok(())
}

impl PointField {
    fn read(reader: &mut Reader<'_>) -> Result<Self, FormatError> {
        let name = reader.string("field name")?;
        let offset = reader.u32("field offset")? as usize;
        let type_at = reader.position();
        let datatype = reader.u8("field datatype")?;
        let number_type = number_type(datatype).ok_or_else(|| {
            FormatError::field("field datatype", type_at, "1 to 8", format!("{datatype} for `{name}`"))
        })?;
        let stated_count = reader.u32("field count")?;
        let field = Field { name: name.into(), number_type, count: (stated_count as usize).max(1) };
        Ok(Self { field, offset, stated_count })
    }

    /// True for bytes that PCL's tools name `_` because they mean nothing.
    pub(super) fn is_padding(&self) -> bool {
        self.field.name == record::PADDING
    }
}

/// `sensor_msgs/msg/PointField`'s types, from 1 on.
const TYPES: [NumberType; 8] = [
    NumberType::I8,
    NumberType::U8,
    NumberType::I16,
    NumberType::U16,
    NumberType::I32,
    NumberType::U32,
    NumberType::F32,
    NumberType::F64,
];

fn number_type(datatype: u8) -> Option<NumberType> {
    TYPES.get(usize::from(datatype).checked_sub(1)?).copied()
}

/// The number of a type; none for 64-bit integers.
pub(super) fn datatype(number_type: NumberType) -> Option<u8> {
    TYPES.iter().position(|known| *known == number_type).map(|i| i as u8 + 1)
}
