//! ROS 2's `sensor_msgs/msg/PointCloud2`, serialised as CDR: what DDS carries and bags store.
//!
//! Read is every layout: fields at any place, of any type, of several values, with bytes between them; rows with bytes after them
//! (organised clouds); points and message of either byte order. `is_dense` is not believed: points are looked at. A cloud that came in a
//! message is written as one of the same layout, frame and stamp, in one row; any other gets fields at multiples of their size.

mod cdr;
mod message;
mod write;

use std::sync::Arc;

use super::number::{self, Endian, Lane};
use super::record::{self, Field};
use super::{FormatError, Limits, input, meaning};
use crate::PointCloud;
use crate::cloud::Column;
use cdr::Reader;
use message::{PointField, Stamp};

pub use message::RosMessage;
pub(super) use write::encode;

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<PointCloud, FormatError> {
    let mut reader = Reader::new(bytes)?;
    let stamp = Stamp { seconds: reader.u32("stamp.sec")?, nanoseconds: reader.u32("stamp.nanosec")? };
    let frame_id = reader.string("frame_id")?.to_owned();
    let height = reader.u32("height")? as usize;
    let width = reader.u32("width")? as usize;
    let points = input::check_points(height as u128 * width as u128, "width", reader.position(), limits)?;
    let fields = message::read_fields(&mut reader)?;
    let data_endian = if reader.bool("is_bigendian")? { Endian::Big } else { Endian::Little };
    let point_step = reader.u32("point_step")? as usize;
    message::check_layout(&fields, point_step, reader.position())?;
    let row_step = reader.u32("row_step")? as usize;
    let data_at = reader.position();
    let data = reader.bytes("data")?;
    reader.bool("is_dense")?;
    let endian = reader.endian();
    reader.end()?;

    let rows =
        if points == 0 { Rows::NONE } else { Rows::new(data, [height, width], [point_step, row_step], data_at)? };
    let columns = fields.iter().filter(|field| !field.is_padding());
    let columns: Vec<Column> = columns.flat_map(|field| rows.columns(field, data_endian)).collect();
    let mut cloud = if points == 0 && columns.is_empty() {
        // A message that nobody filled.
        PointCloud::new(1.0)
    } else {
        meaning::cloud_of(columns, None, limits)?
    };
    cloud.ros = Some(Arc::new(RosMessage { stamp, frame_id, fields, point_step, data_endian, endian }));
    Ok(cloud)
}

/// A message's points, row by row.
struct Rows<'a> {
    data: &'a [u8],
    /// Bytes from row to row.
    row_step: usize,
    /// Bytes of a row's points; more may follow.
    row_bytes: usize,
    point_step: usize,
}

impl<'a> Rows<'a> {
    const NONE: Self = Rows { data: &[], row_step: 1, row_bytes: 0, point_step: 1 };

    /// Rows of the data, which have to be all there is. In a message of one row `row_step` says nothing, and not all writers set it.
    fn new(
        data: &'a [u8],
        [height, width]: [usize; 2],
        [point_step, row_step]: [usize; 2],
        offset: usize,
    ) -> Result<Self, FormatError> {
        let row_bytes = width * point_step;
        let row_step = if height == 1 { data.len() } else { row_step };
        if row_step < row_bytes {
            return Err(input::truncated("row_step", offset, row_bytes, row_step));
        }
        match height.checked_mul(row_step) {
            Some(bytes) if bytes == data.len() => Ok(Self { data, row_step, row_bytes, point_step }),
            _ => {
                let expected = format!("height × row_step = {height} × {row_step} bytes");
                Err(FormatError::field("data", offset, expected, data.len()))
            }
        }
    }

    /// A field's values: one column, or several of a field of several values.
    fn columns(&self, field: &PointField, endian: Endian) -> impl Iterator<Item = Column> {
        let Field { number_type, count, .. } = field.field;
        (0..count).map(move |i| {
            let lane = Lane { stride: self.point_step, offset: field.offset + i * number_type.bytes(), endian };
            let mut values = number_type.column();
            for row in self.data.chunks_exact(self.row_step) {
                number::append(&mut values, &row[..self.row_bytes], lane);
            }
            Column { name: record::column_name(&field.field, i), values }
        })
    }
}
