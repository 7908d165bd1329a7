//! Stanford PLY ("The PLY Polygon File Format", Greg Turk, 1994): points are the element `vertex`.
//!
//! The reader is our own: `ply-rs` and its fork build a hash map a point (100 ms and more a scan) and panic or swell on crafted
//! counts. Points of plain numbers are packed records that [`record`] reads strided, at the speed of memory. The fork is the
//! tests' oracle. Faces and other elements are skipped, unread where they follow the points.

mod header;

use super::number::{Endian, NumberType};
use super::{FormatError, Limits, input, meaning, record, text};
use crate::PointCloud;
use header::{Encoding, Header};

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<PointCloud, FormatError> {
    let header = Header::read(bytes)?;
    let Some(vertex) = header.elements.iter().position(|element| element.name == "vertex") else {
        let present: Vec<_> = header.elements.iter().map(|element| element.name.as_str()).collect();
        return Err(FormatError::Missing { field: "element vertex", present: present.join(", ") });
    };
    let (before, vertex) = (&header.elements[..vertex], &header.elements[vertex]);
    let points = input::check_points(vertex.count, "element vertex", vertex.offset, limits)?;
    let fields = vertex.fields()?;
    let stride = record::record_bytes(&fields, "element vertex", vertex.offset)?;
    let mut body = input::Input::new(bytes);
    body.seek(header.body_offset, "end_header")?;
    let columns = match header.encoding {
        Encoding::Ascii => {
            for element in before {
                element.skip_lines(&mut body)?;
            }
            text::columns(&fields, body.rest(), points, body.position())?
        }
        Encoding::Binary(endian) => {
            for element in before {
                element.skip_bytes(&mut body, endian)?;
            }
            let needed = points.saturating_mul(stride);
            record::columns(&fields, body.take(needed, "element vertex")?, endian)
        }
    };
    meaning::cloud_of(columns, header.full_scale, limits)
}

pub(super) fn encode(cloud: &PointCloud) -> Vec<u8> {
    let mut columns = record::written(cloud);
    columns.iter_mut().for_each(record::without_64_bit_integers);
    let property = |column: &record::Written<'_>| {
        let name = record::word(&column.name);
        format!("property {} {name}\n", header::type_name(column.numbers.number_type()))
    };
    let header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment {} {}\nelement vertex {}\n{}end_header\n",
        record::FULL_SCALE_NOTE,
        cloud.full_scale,
        cloud.len(),
        columns.iter().map(property).collect::<String>()
    );
    record::append_records(header.into_bytes(), &columns, cloud.len())
}
