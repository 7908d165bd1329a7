//! ASPRS LAS 1.0–1.4 (R15) and its compressed form LAZ, on the crates `las` and `laz`.
//!
//! Both crates believe their headers: a crafted chunk table, EVLR or layer size makes them ask for tens of gigabytes and abort. So
//! [`header`] and [`laz`](self::laz) check all that the crates would allocate by before they see a file, and EVLRs are left unread.
//!
//! Written are LAS 1.4, point format 6, 7 (colours) or 8 (near infrared), coordinates in steps of 0.1 mm. Fields without a place in
//! the record are extra bytes: `ring` (u16), `label` (u32), `time` (f64), `intensity` (f32) where 16 bits would lose some of it, and
//! every extra column. The record's own attributes become extra columns where they are not all zero: `las_classification` (ASPRS
//! classes, not `SemanticKITTI`'s), `number_of_returns`, `las_flags`, `scan_angle_deg`, `user_data`, `point_source_id`, `gps_time` (the
//! cloud's time where no extra bytes are called `time`), `red`, `green`, `blue`, `nir`. Skipped are waveforms,
//! and the GPS time of LAZ in point formats 6–10 (see [`laz`](self::laz)); what we write ourselves has its time in extra bytes too.

mod attributes;
mod columns;
mod extra_bytes;
mod gps_time;
mod header;
mod laz;
mod write;

use super::record::{self, Field};
use super::{FormatError, Limits, input, meaning};
use crate::PointCloud;
use columns::Columns;
use header::Header;

pub(super) use write::encode;

/// Points that are unpacked at a time.
const STEP: usize = 50_000;

/// Most extra bytes a point: 64 doubles. LAZ keeps tables of several kilobytes for each.
const MAX_EXTRA_BYTES: u16 = 512;

/// Our variable length record: one text, the intensity that means 1.
const NOTE_USER: &str = "realbeam";
const NOTE_RECORD: u16 = 1;

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<PointCloud, FormatError> {
    let header = Header::read(bytes, limits)?;
    let mut columns = Columns::new(&header);
    if header.format.is_compressed {
        laz::unpack(bytes, &header, |records| columns.append(records))?;
    } else {
        let body = &bytes[header.body_offset..][..header.points * header.record_bytes];
        for records in body.chunks(STEP * header.record_bytes) {
            columns.append(records.to_vec())?;
        }
    }
    let (columns, full_scale) = columns.finish();
    meaning::cloud_of(columns, Some(full_scale), limits)
}

fn library(error: impl std::fmt::Display) -> FormatError {
    FormatError::Library { library: "las", message: error.to_string() }
}
