//! Packed records, one a point: how PLY, PCD and NPY store columns in binary, and what all of them write.

use std::borrow::Cow;

use super::number::{Endian, Lane, NumberType, Numbers, column};
use super::{FormatError, Limits};
use crate::PointCloud;
use crate::cloud::Column;

/// One field of a record: `count` numbers of one type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) number_type: NumberType,
    pub(super) count: usize,
}

impl Field {
    pub(super) fn bytes(&self) -> usize {
        self.count.saturating_mul(self.number_type.bytes())
    }
}

/// Most numbers in a record. Real scans have under thirty.
const MAX_NUMBERS: usize = 512;

/// Bytes of one record, where it is not absurd.
pub(super) fn record_bytes(fields: &[Field], field: &str, offset: usize) -> Result<usize, FormatError> {
    let numbers = fields.iter().fold(0_usize, |sum, field| sum.saturating_add(field.count));
    if numbers > MAX_NUMBERS {
        let found = format!("{numbers} numbers a point");
        return Err(FormatError::TooMany { field: field.into(), offset, found, limit: MAX_NUMBERS });
    }
    Ok(fields.iter().map(Field::bytes).sum())
}

/// The columns of whole records. A field of several numbers becomes as many columns, `name_0`, `name_1`, …
pub(super) fn columns(fields: &[Field], records: &[u8], endian: Endian) -> Vec<Column> {
    let stride = fields.iter().map(Field::bytes).sum();
    let mut offset = 0;
    let mut columns = Vec::new();
    for field in fields {
        for i in 0..field.count {
            let values = if stride == 0 {
                field.number_type.column()
            } else {
                column(field.number_type, records, Lane { stride, offset, endian })
            };
            columns.push(Column { name: column_name(field, i), values });
            offset += field.number_type.bytes();
        }
    }
    columns
}

/// Name of the column that number `i` of a field becomes.
pub(super) fn column_name(field: &Field, i: usize) -> String {
    if field.count == 1 { field.name.clone() } else { format!("{}_{i}", field.name) }
}

/// Name of the bytes between fields, which mean nothing (PCD's word for them).
pub(super) const PADDING: &str = "_";

/// Removes what [`columns`] made of padding.
pub(super) fn drop_padding(columns: &mut Vec<Column>) {
    let is_index = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let is_padding = |name: &str| {
        let rest = name.strip_prefix(PADDING);
        rest.is_some_and(|rest| rest.is_empty() || rest.strip_prefix('_').is_some_and(is_index))
    };
    columns.retain(|column| !is_padding(&column.name));
}

/// A column to write.
#[derive(Clone, Debug)]
pub(super) struct Written<'a> {
    pub(super) name: Cow<'a, str>,
    pub(super) numbers: Numbers<'a>,
}

/// Every field of a cloud, under the names that [`meaning`](super::meaning) reads back, each name once.
pub(super) fn written(cloud: &PointCloud) -> Vec<Written<'_>> {
    let known = |name: &'static str, numbers| Some(Written { name: Cow::Borrowed(name), numbers });
    let mut written: Vec<_> = [
        known("x", Numbers::F32((&cloud.x).into())),
        known("y", Numbers::F32((&cloud.y).into())),
        known("z", Numbers::F32((&cloud.z).into())),
        known("intensity", intensity(cloud)),
        cloud.ring.as_ref().and_then(|ring| known("ring", Numbers::U16(ring.into()))),
        cloud.label.as_ref().and_then(|label| known("label", Numbers::U32(label.into()))),
        cloud.time_s.as_ref().and_then(|time| known("time", Numbers::F64(time.into()))),
        cloud.return_number.as_ref().and_then(|number| known("return_number", Numbers::U8(number.into()))),
    ]
    .into_iter()
    .flatten()
    .collect();
    for column in &cloud.extra {
        let mut name = Cow::Borrowed(column.name.as_str());
        let mut copy = 2;
        while written.iter().any(|other| other.name.eq_ignore_ascii_case(&name)) {
            name = Cow::Owned(format!("{}_{copy}", column.name));
            copy += 1;
        }
        written.push(Written { name, numbers: Numbers::from(&column.values) });
    }
    written
}

/// The intensity as bytes or 16-bit numbers where that loses nothing, so that its type says its scale again.
fn intensity(cloud: &PointCloud) -> Numbers<'_> {
    let all_whole = cloud.intensity.iter().all(|i| (0.0..=cloud.full_scale).contains(i) && i.fract() == 0.0);
    if all_whole && cloud.full_scale == 255.0 {
        Numbers::U8(cloud.intensity.iter().map(|&i| i as u8).collect::<Vec<_>>().into())
    } else if all_whole && cloud.full_scale == 65535.0 {
        Numbers::U16(cloud.intensity.iter().map(|&i| i as u16).collect::<Vec<_>>().into())
    } else {
        Numbers::F32((&cloud.intensity).into())
    }
}

/// The packed little-endian records of the columns, appended to a header.
pub(super) fn append_records(header: Vec<u8>, columns: &[Written<'_>], points: usize) -> Vec<u8> {
    let stride: usize = columns.iter().map(|column| column.numbers.number_type().bytes()).sum();
    let mut file = header;
    let start = file.len();
    file.resize(start + stride * points, 0);
    let mut offset = 0;
    for column in columns {
        if stride > 0 {
            column.numbers.write(&mut file[start..], stride, offset);
        }
        offset += column.numbers.number_type().bytes();
    }
    file
}

/// Empty columns for `fields`, to be filled number by number.
pub(super) fn empty_columns(fields: &[Field]) -> Vec<Column> {
    let empty =
        |(field, i): (&Field, usize)| Column { name: column_name(field, i), values: field.number_type.column() };
    fields.iter().flat_map(|field| (0..field.count).map(move |i| (field, i))).map(empty).collect()
}

/// A fixed-point float of a header comment that says which intensity means 1.
pub(super) const FULL_SCALE_NOTE: &str = "intensity_full_scale";

/// Reads [`FULL_SCALE_NOTE`] and its number from a comment.
pub(super) fn full_scale_note(comment: &str) -> Option<f32> {
    let number = comment.trim().strip_prefix(FULL_SCALE_NOTE)?.trim();
    number.parse().ok().filter(|&scale: &f32| scale.is_finite() && scale > 0.0)
}

/// Checks that `points` records fit the limits on unpacked bytes.
pub(super) fn check_unpacked(
    points: usize,
    stride: usize,
    field: &str,
    offset: usize,
    limits: &Limits,
) -> Result<usize, FormatError> {
    let bytes = points as u128 * stride as u128;
    let limit = limits.max_unpacked_bytes;
    match usize::try_from(bytes) {
        Ok(bytes) if bytes <= limit => Ok(bytes),
        _ => Err(FormatError::TooMany { field: field.into(), offset, found: format!("{bytes} bytes"), limit }),
    }
}

/// Widens 64-bit integers to doubles, for a format without them.
pub(super) fn without_64_bit_integers(column: &mut Written<'_>) {
    let double = match &column.numbers {
        Numbers::I64(integers) => integers.iter().map(|&v| v as f64).collect::<Vec<_>>(),
        Numbers::U64(integers) => integers.iter().map(|&v| v as f64).collect(),
        _ => return,
    };
    column.numbers = Numbers::F64(double.into());
}

/// A column's name as one word of a text header.
pub(super) fn word(name: &str) -> String {
    let word: String = name.chars().map(|c| if c.is_whitespace() || c.is_control() { '_' } else { c }).collect();
    if word.is_empty() { "unnamed".into() } else { word }
}
