//! Extra bytes: fields of a LAS record that the format does not know (LAS 1.4 R15, "Extra Bytes", tables 24 and 25).

use super::{Field, FormatError};
use crate::cloud::{Column, Values};
use crate::formats::input::{Input, truncated};
use crate::formats::number::{self, Endian, Lane, NumberType};
use crate::formats::record::column_name;

/// Size of one descriptor.
const DESCRIPTOR_BYTES: usize = 192;
const NAME_BYTES: usize = 32;
/// Bits of a descriptor's options that say which of its numbers count.
const HAS_SCALE: u8 = 8;
const HAS_OFFSET: u8 = 16;

/// One described field.
#[derive(Clone, Debug)]
pub(super) struct ExtraField {
    pub(super) field: Field,
    /// Scale and offset of each of its numbers, where the file gives some.
    scaling: Option<[(f64, f64); 3]>,
}

/// Reads the descriptors of `extra_bytes` bytes a point.
pub(super) fn parse(data: &[u8], extra_bytes: u16, offset: usize) -> Result<Vec<ExtraField>, FormatError> {
    let mut fields = Vec::new();
    let mut described = 0;
    for (i, descriptor) in data.chunks_exact(DESCRIPTOR_BYTES).enumerate() {
        let offset = offset + i * DESCRIPTOR_BYTES;
        let extra = parse_one(descriptor, offset)?;
        described += extra.field.bytes();
        if described > usize::from(extra_bytes) {
            return Err(truncated(&extra.field.name, offset, format!("{described} extra"), extra_bytes.into()));
        }
        fields.push(extra);
    }
    fields.extend(undescribed(extra_bytes - described as u16, described));
    Ok(fields)
}

/// Bytes without a descriptor, each a column of its own. `first` is the place of the first one among the extra bytes.
pub(super) fn undescribed(count: u16, first: usize) -> Vec<ExtraField> {
    let byte = |i: usize| Field { name: format!("extra_byte_{}", first + i), number_type: NumberType::U8, count: 1 };
    (0..usize::from(count)).map(|i| ExtraField { field: byte(i), scaling: None }).collect()
}

fn parse_one(descriptor: &[u8], offset: usize) -> Result<ExtraField, FormatError> {
    const FIELD: &str = "extra bytes descriptor";
    let mut input = Input::new(descriptor);
    input.take(2, FIELD)?;
    let [kind, options] = input.array(FIELD)?;
    let name: [u8; NAME_BYTES] = input.array(FIELD)?;
    input.take(4 + 3 * 24, FIELD)?;
    let mut triple = || -> Result<[f64; 3], FormatError> {
        let mut numbers = [0.0; 3];
        for number in &mut numbers {
            *number = f64::from_le_bytes(input.array(FIELD)?);
        }
        Ok(numbers)
    };
    let (scale, shift) = (triple()?, triple()?);
    let (number_type, count) = match kind {
        0 => (NumberType::U8, usize::from(options)),
        // 11–20 and 21–30 are pairs and triples of 1–10, deprecated.
        1..=30 => (TYPES[usize::from(kind - 1) % 10], usize::from(kind - 1) / 10 + 1),
        _ => return Err(FormatError::field("extra bytes data type", offset + 2, "0 to 30", kind)),
    };
    let is_scaled = kind != 0 && options & (HAS_SCALE | HAS_OFFSET) != 0;
    let scaling = is_scaled.then(|| {
        let of = |i: usize| {
            let scale = if options & HAS_SCALE == 0 { 1.0 } else { scale[i] };
            (scale, if options & HAS_OFFSET == 0 { 0.0 } else { shift[i] })
        };
        [of(0), of(1), of(2)]
    });
    let end = name.iter().position(|&byte| byte == 0).unwrap_or(NAME_BYTES);
    let name = String::from_utf8_lossy(&name[..end]).into_owned();
    Ok(ExtraField { field: Field { name, number_type, count }, scaling })
}

/// Types 1–10 of a descriptor.
const TYPES: [NumberType; 10] = [
    NumberType::U8,
    NumberType::I8,
    NumberType::U16,
    NumberType::I16,
    NumberType::U32,
    NumberType::I32,
    NumberType::U64,
    NumberType::I64,
    NumberType::F32,
    NumberType::F64,
];

/// Empty columns for the fields.
pub(super) fn empty_columns(extra: &[ExtraField]) -> Vec<Column> {
    let columns = extra.iter().flat_map(|extra| (0..extra.field.count).map(move |i| (&extra.field, i)));
    columns.map(|(field, i)| Column { name: column_name(field, i), values: field.number_type.column() }).collect()
}

/// Appends the fields' numbers of some records, whose extra bytes start at `offset`.
pub(super) fn append(columns: &mut [Column], extra: &[ExtraField], records: &[u8], stride: usize, mut offset: usize) {
    let types = extra.iter().flat_map(|extra| std::iter::repeat_n(extra.field.number_type, extra.field.count));
    for (column, number_type) in columns.iter_mut().zip(types) {
        number::append(&mut column.values, records, Lane { stride, offset, endian: Endian::Little });
        offset += number_type.bytes();
    }
}

/// Turns the stored numbers of scaled fields into what they mean.
pub(super) fn scale(columns: &mut [Column], extra: &[ExtraField]) {
    let scalings = extra.iter().flat_map(|extra| (0..extra.field.count).map(|i| extra.scaling.map(|s| s[i.min(2)])));
    for (column, scaling) in columns.iter_mut().zip(scalings) {
        if let Some((scale, offset)) = scaling {
            let scaled = column.values.to_f64().into_iter().map(|stored| stored * scale + offset);
            column.values = Values::F64(scaled.collect());
        }
    }
}

/// The descriptor of a column to write.
pub(super) fn describe(name: &str, number_type: NumberType) -> Vec<u8> {
    let mut descriptor = vec![0; DESCRIPTOR_BYTES];
    let kind = TYPES.iter().position(|&other| other == number_type).unwrap_or(0) + 1;
    descriptor[2] = kind as u8;
    // Cut at a character's start, with a zero at the end for readers that need one.
    let mut end = name.len().min(NAME_BYTES - 1);
    while !name.is_char_boundary(end) {
        end -= 1;
    }
    descriptor[4..4 + end].copy_from_slice(&name.as_bytes()[..end]);
    descriptor
}
