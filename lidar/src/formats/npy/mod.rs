//! `NumPy`'s `.npy` (NEP 1): one array, structured with named fields, or plain with a column a number.
//!
//! The reader is our own: the general ones parse the header's Python literal by recursion without a limit, and a header of nothing
//! but brackets overflows their stack. `npyz` is the tests' oracle. Written structured, one record a point.

mod array;
mod header;
mod literal;

use super::number::{Endian, NumberType};
use super::record::{self, Field, Written};
use super::{FormatError, Limits, meaning};
use crate::PointCloud;
use crate::cloud::Column;

pub(super) use array::Array;
pub(super) use header::{descr, write_header};

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<PointCloud, FormatError> {
    let array = Array::read(bytes)?;
    organised(array.point_shape(), array.point_columns(limits)?, None, limits)
}

/// A cloud of the columns of an array of points. Where the shape is a range image's, `[ring, column]`, its row is the ring, and
/// pixels without a return are kept out.
pub(super) fn organised(
    shape: &[usize],
    columns: Vec<Column>,
    full_scale: Option<f32>,
    limits: &Limits,
) -> Result<PointCloud, FormatError> {
    let range = columns.iter().find(|column| column.name == "range_m").map(|column| column.values.to_f64());
    let mut cloud = meaning::cloud_of(columns, full_scale, limits)?;
    cloud.check()?;
    let &[rings, width] = shape else { return Ok(cloud) };
    if cloud.ring.is_none() && u16::try_from(rings).is_ok() {
        cloud.ring = Some((0..cloud.len()).map(|i| (i / width.max(1)) as u16).collect());
    }
    let is_return = |i: usize| match &range {
        Some(range) => range[i] > 0.0,
        None => [cloud.x[i], cloud.y[i], cloud.z[i]] != [0.0; 3],
    };
    let returns: Vec<u32> = (0..cloud.len()).filter(|&i| is_return(i)).map(|i| i as u32).collect();
    Ok(cloud.select(&returns))
}

pub(super) fn encode(cloud: &PointCloud) -> Result<Vec<u8>, FormatError> {
    let columns = record::written(cloud);
    let fields: Vec<_> = columns
        .iter()
        .map(|Written { name, numbers }| format!("('{}', '{}')", quoted(name), header::descr(numbers.number_type())))
        .collect();
    let header = write_header(&format!("[{}]", fields.join(", ")), &cloud.len().to_string())?;
    Ok(record::append_records(header, &columns, cloud.len()))
}

/// A field's name as the inside of a Python string.
fn quoted(name: &str) -> String {
    let name: String = name.chars().map(|c| if matches!(c, '\'' | '\\') || c.is_control() { '_' } else { c }).collect();
    // NumPy takes an empty name for padding.
    if name.is_empty() { "unnamed".into() } else { name }
}
