//! The Point Cloud Library's PCD 0.7 ("The PCD file format", pcl.readthedocs.io): ASCII, binary, or binary compressed by LZF.
//!
//! The reader is our own, for the same reasons as PLY's; `pcd-rs` is the tests' oracle. Written binary, one row of points.

mod header;
mod lzf;

use super::input::{self, Input};
use super::number::{Endian, NumberType};
use super::record::{self, Field};
use super::{FormatError, Limits, meaning, number, text};
use crate::PointCloud;
use crate::cloud::Column;
use header::{Data, Header};

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<PointCloud, FormatError> {
    let header = Header::read(bytes)?;
    let points = input::check_points(header.points, "POINTS", header.points_offset, limits)?;
    let stride = record::record_bytes(&header.fields, "COUNT", header.points_offset)?;
    let mut body = Input::new(bytes);
    body.seek(header.body_offset, "DATA")?;
    let mut columns = match header.data {
        Data::Ascii => text::columns(&header.fields, body.rest(), points, body.position())?,
        Data::Binary => {
            let needed = points.saturating_mul(stride);
            record::columns(&header.fields, body.take(needed, "POINTS")?, Endian::Little)
        }
        Data::Compressed => {
            let unpacked = record::check_unpacked(points, stride, "POINTS", header.points_offset, limits)?;
            by_field(&header.fields, &unpack(&mut body, unpacked)?, points)
        }
    };
    record::drop_padding(&mut columns);
    meaning::cloud_of(columns, header.full_scale, limits)
}

/// The compressed body: both sizes, then LZF.
fn unpack(body: &mut Input<'_>, expected: usize) -> Result<Vec<u8>, FormatError> {
    let packed = body.u32("compressed size")? as usize;
    let offset = body.position();
    let unpacked = body.u32("uncompressed size")? as usize;
    if unpacked != expected {
        return Err(FormatError::field("uncompressed size", offset, format!("{expected} bytes"), unpacked));
    }
    let offset = body.position();
    lzf::unpack(body.take(packed, "compressed size")?, unpacked, offset)
}

/// The columns of an unpacked body, which holds all values of the first field, then all of the second, and so on.
fn by_field(fields: &[Field], bytes: &[u8], points: usize) -> Vec<Column> {
    let mut start = 0;
    let mut columns = Vec::new();
    for field in fields {
        let end = start + field.bytes() * points;
        let stride = field.bytes().max(1);
        for i in 0..field.count {
            let lane = number::Lane { stride, offset: i * field.number_type.bytes(), endian: Endian::Little };
            let values = number::column(field.number_type, &bytes[start..end], lane);
            columns.push(Column { name: record::column_name(field, i), values });
        }
        start = end;
    }
    columns
}

pub(super) fn encode(cloud: &PointCloud) -> Vec<u8> {
    let columns = record::written(cloud);
    let list = |word: fn(&record::Written<'_>) -> String| columns.iter().map(word).collect::<Vec<_>>().join(" ");
    let points = cloud.len();
    let header = format!(
        "# .PCD v0.7 - Point Cloud Data file format\n# {} {}\nVERSION 0.7\nFIELDS {}\nSIZE {}\nTYPE {}\nCOUNT {}\n\
         WIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA binary\n",
        record::FULL_SCALE_NOTE,
        cloud.full_scale,
        list(|column| record::word(&column.name)),
        list(|column| column.numbers.number_type().bytes().to_string()),
        list(|column| header::type_letter(column.numbers.number_type()).into()),
        list(|_| "1".into()),
    );
    record::append_records(header.into_bytes(), &columns, points)
}
