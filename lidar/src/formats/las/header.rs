//! A LAS header whose every size has been checked against the file.

use las::point::Format;
use las::raw;
use las::{Transform, Vector};

use super::extra_bytes::{self, ExtraField};
use super::{FormatError, Limits, MAX_EXTRA_BYTES, NOTE_RECORD, NOTE_USER, input, library, record};
use crate::formats::input::{Input, truncated};

/// Offsets of header fields, for messages (LAS 1.4 R15, table 3).
const AT_HEADER_SIZE: usize = 94;
const AT_POINT_DATA: usize = 96;
const AT_VLR_COUNT: usize = 100;
const AT_FORMAT: usize = 104;
const AT_RECORD_LENGTH: usize = 105;
const AT_POINTS: usize = 107;
const AT_SCALE: usize = 131;
const AT_LARGE_POINTS: usize = 247;
const HEADER_BYTES: usize = 227;

/// A scan has a handful of records; the largest GIS files some dozens.
const MAX_VLRS: u32 = 1024;

#[derive(Debug)]
pub(super) struct Header {
    /// The point format, extra bytes included; `is_compressed` for LAZ.
    pub(super) format: Format,
    /// The number of the format, 0–10.
    pub(super) format_id: u8,
    pub(super) transforms: Vector<Transform>,
    pub(super) points: usize,
    pub(super) record_bytes: usize,
    pub(super) body_offset: usize,
    pub(super) extra: Vec<ExtraField>,
    /// Data of the `LASzip` record and where it is.
    pub(super) laszip: Option<(Vec<u8>, usize)>,
    /// The intensity that means 1, from our own record.
    pub(super) full_scale: Option<f32>,
}

impl Header {
    pub(super) fn read(bytes: &[u8], limits: &Limits) -> Result<Self, FormatError> {
        if bytes.len() < HEADER_BYTES {
            return Err(truncated("public header block", 0, HEADER_BYTES, bytes.len()));
        }
        // A checked size: the crate reads the rest of a long header into memory, 64 KiB at the most.
        let raw = raw::Header::read_from(bytes).map_err(library)?;
        let header_bytes = usize::from(raw.header_size);
        if header_bytes < HEADER_BYTES {
            let expected = format!("at least {HEADER_BYTES}");
            return Err(FormatError::field("header size", AT_HEADER_SIZE, expected, header_bytes));
        }
        let body_offset = raw.offset_to_point_data as usize;
        if body_offset < header_bytes || body_offset > bytes.len() {
            let expected = format!("{header_bytes} to {}, inside the file", bytes.len());
            return Err(FormatError::field("offset to point data", AT_POINT_DATA, expected, body_offset));
        }
        let format = point_format(&raw)?;
        let record_bytes = usize::from(raw.point_data_record_length);
        let (points, at_points) = point_count(&raw);
        let points = input::check_points(points.into(), "number of point records", at_points, limits)?;
        if format.is_compressed {
            record::check_unpacked(points, record_bytes, "number of point records", at_points, limits)?;
        } else {
            let needed = points as u128 * record_bytes as u128;
            let available = bytes.len() - body_offset;
            if needed > available as u128 {
                return Err(truncated("number of point records", at_points, needed, available));
            }
        }
        let mut header = Self {
            format,
            format_id: raw.point_data_record_format & 0x3f,
            transforms: transforms(&raw)?,
            points,
            record_bytes,
            body_offset,
            extra: Vec::new(),
            laszip: None,
            full_scale: None,
        };
        header.read_vlrs(&raw, &bytes[..body_offset])?;
        Ok(header)
    }

    /// Reads the records between the header and the points; what they mean to others is passed by.
    fn read_vlrs(&mut self, raw: &raw::Header, bytes: &[u8]) -> Result<(), FormatError> {
        let count = raw.number_of_variable_length_records;
        if count > MAX_VLRS {
            return Err(FormatError::TooMany {
                field: "number of variable length records".into(),
                offset: AT_VLR_COUNT,
                found: count.to_string(),
                limit: MAX_VLRS as usize,
            });
        }
        let mut input = Input::new(bytes);
        input.seek(usize::from(raw.header_size), "header size")?;
        for _ in 0..count {
            const FIELD: &str = "variable length record";
            input.take(2, FIELD)?;
            let user: [u8; 16] = input.array(FIELD)?;
            let record_id = input.u16(FIELD)?;
            let length = input.u16(FIELD)?;
            input.take(32, FIELD)?;
            let offset = input.position();
            let data = input.take(usize::from(length), FIELD)?;
            match (user.as_slice().trim_suffix_zeros(), record_id) {
                (b"LASF_Spec", 4) => self.extra = extra_bytes::parse(data, self.format.extra_bytes, offset)?,
                (b"laszip encoded", ::laz::LazVlr::RECORD_ID) => self.laszip = Some((data.into(), offset)),
                (user, NOTE_RECORD) if user == NOTE_USER.as_bytes() => {
                    self.full_scale = str::from_utf8(data).ok().and_then(record::full_scale_note);
                }
                _ => {}
            }
        }
        if self.extra.is_empty() {
            self.extra = extra_bytes::undescribed(self.format.extra_bytes, 0);
        }
        Ok(())
    }
}

/// Text in a fixed field ends with zeros.
trait TrimZeros {
    fn trim_suffix_zeros(&self) -> &[u8];
}

impl TrimZeros for [u8] {
    fn trim_suffix_zeros(&self) -> &[u8] {
        &self[..self.iter().position(|&byte| byte == 0).unwrap_or(self.len())]
    }
}

fn point_format(raw: &raw::Header) -> Result<Format, FormatError> {
    let id = raw.point_data_record_format;
    let mut format = Format::new(id)
        .ok()
        .filter(|_| id & 0x3f <= 10)
        .ok_or_else(|| FormatError::field("point data record format", AT_FORMAT, "0 to 10", id))?;
    let length = raw.point_data_record_length;
    format.extra_bytes = length.checked_sub(format.len()).ok_or_else(|| {
        let expected = format!("at least {} bytes", format.len());
        FormatError::field("point data record length", AT_RECORD_LENGTH, expected, length)
    })?;
    if format.extra_bytes > MAX_EXTRA_BYTES {
        return Err(FormatError::TooMany {
            field: "point data record length".into(),
            offset: AT_RECORD_LENGTH,
            found: format!("{} extra bytes", format.extra_bytes),
            limit: MAX_EXTRA_BYTES.into(),
        });
    }
    Ok(format)
}

/// The count of points and where it is. The old field goes first: it is zero where it must not be used (R15, "Legacy").
fn point_count(raw: &raw::Header) -> (u64, usize) {
    match (raw.number_of_point_records, &raw.large_file) {
        (0, Some(large)) => (large.number_of_point_records, AT_LARGE_POINTS),
        (legacy, _) => (legacy.into(), AT_POINTS),
    }
}

fn transforms(raw: &raw::Header) -> Result<Vector<Transform>, FormatError> {
    let transform = |axis: &str, scale: f64, offset: f64| {
        if scale.is_finite() && scale != 0.0 && offset.is_finite() {
            return Ok(Transform { scale, offset });
        }
        let found = format!("{scale} and {offset}");
        Err(FormatError::field(format!("{axis} scale and offset"), AT_SCALE, "finite numbers, the scale not 0", found))
    };
    Ok(Vector {
        x: transform("x", raw.x_scale_factor, raw.x_offset)?,
        y: transform("y", raw.y_scale_factor, raw.y_offset)?,
        z: transform("z", raw.z_scale_factor, raw.z_offset)?,
    })
}
