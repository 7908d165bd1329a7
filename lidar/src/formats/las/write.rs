//! Writing LAS and LAZ.

use std::io::Cursor;

use las::{Builder, PointDataBuilder, Transform, Vector, Version, Vlr, Writer};

use super::attributes::Placed;
use super::{FormatError, MAX_EXTRA_BYTES, NOTE_RECORD, NOTE_USER, extra_bytes, library};
use crate::PointCloud;
use crate::formats::number::Numbers;
use crate::formats::record::{self, FULL_SCALE_NOTE, Written};

/// A tenth of a millimetre: far below any lidar's noise, and ±214 km still fit 32 bits.
const STEP_M: f64 = 1e-4;

/// Most bytes of a variable length record.
const MAX_VLR_BYTES: usize = u16::MAX as usize;

/// Writes a cloud as LAS, or as LAZ where `is_compressed`.
pub(in crate::formats) fn encode(cloud: &PointCloud, is_compressed: bool) -> Result<Vec<u8>, FormatError> {
    let placed = Placed::new(&cloud.extra, !is_compressed, cloud.time_s.is_some());
    let (intensity, is_exact) = intensity(cloud);
    let returns = cloud.return_number.as_deref().filter(|n| n.iter().all(|&n| n < 16) && n.iter().any(|&n| n > 0));
    let extra = extra_columns(cloud, &placed, is_exact, returns.is_some());
    let mut format = placed.format();
    let standard_bytes = usize::from(format.len());
    let extra_total: usize = extra.iter().map(|column| column.numbers.number_type().bytes()).sum();
    let descriptors: Vec<u8> =
        extra.iter().flat_map(|column| extra_bytes::describe(&column.name, column.numbers.number_type())).collect();
    // Of columns of single bytes, 341 descriptors fill their record before the bytes are too many.
    if extra_total > usize::from(MAX_EXTRA_BYTES) || descriptors.len() > MAX_VLR_BYTES {
        let (field, limit) = ("extra bytes".into(), MAX_EXTRA_BYTES.into());
        let found = format!("{} columns of {extra_total} bytes", extra.len());
        return Err(FormatError::TooMany { field, offset: 0, found, limit });
    }
    format.extra_bytes = extra_total as u16;
    format.is_compressed = is_compressed;

    let stride = standard_bytes + extra_total;
    let mut records = vec![0; stride * cloud.len()];
    for (axis, values, offset) in [("x", &cloud.x, 0), ("y", &cloud.y, 4), ("z", &cloud.z, 8)] {
        Numbers::I32(steps(axis, values)?.into()).write(&mut records, stride, offset);
    }
    Numbers::U16(intensity.into()).write(&mut records, stride, 12);
    Numbers::U8(return_bytes(cloud.len(), returns, placed.number_of_returns).into()).write(&mut records, stride, 14);
    if let (Some(time), false) = (&cloud.time_s, placed.has_gps_time) {
        Numbers::F64(time.into()).write(&mut records, stride, 22);
    }
    for (numbers, offset) in &placed.lanes {
        numbers.write(&mut records, stride, *offset);
    }
    let mut offset = standard_bytes;
    for column in &extra {
        column.numbers.write(&mut records, stride, offset);
        offset += column.numbers.number_type().bytes();
    }

    let transform = Transform { scale: STEP_M, offset: 0.0 };
    let mut builder = Builder::default();
    builder.version = Version::new(1, 4);
    builder.point_format = format;
    builder.transforms = Vector { x: transform, y: transform, z: transform };
    builder.generating_software = "realbeam".into();
    let note = format!("{FULL_SCALE_NOTE} {}", cloud.full_scale);
    builder.vlrs.push(vlr(NOTE_USER, NOTE_RECORD, "intensity that means 1", note.into_bytes()));
    if !extra.is_empty() {
        builder.vlrs.push(vlr("LASF_Spec", 4, "extra bytes", descriptors));
    }
    let header = builder.into_header().map_err(library)?;
    let points = PointDataBuilder::new().with_format(format).with_transforms(*header.transforms());
    let points = points.build_from_bytes(records).map_err(library)?;
    let mut writer = Writer::new(Cursor::new(Vec::new()), header).map_err(library)?;
    writer.write_points(&points).map_err(library)?;
    Ok(writer.into_inner().map_err(library)?.into_inner())
}

fn vlr(user: &str, record_id: u16, description: &str, data: Vec<u8>) -> Vlr {
    Vlr { user_id: user.into(), record_id, description: description.into(), data }
}

/// The columns that become extra bytes.
fn extra_columns<'a>(
    cloud: &'a PointCloud,
    placed: &Placed<'_>,
    is_intensity_exact: bool,
    has_returns: bool,
) -> Vec<Written<'a>> {
    let columns = record::written(cloud);
    let own = columns.len() - cloud.extra.len();
    let is_wanted = |(i, column): &(usize, Written<'_>)| match i.checked_sub(own) {
        Some(i) => !placed.columns.contains(&i),
        None => match column.name.as_ref() {
            "x" | "y" | "z" => false,
            "intensity" => !is_intensity_exact,
            "return_number" => !has_returns,
            _ => true,
        },
    };
    columns.into_iter().enumerate().filter(is_wanted).map(|(_, column)| column).collect()
}

/// The intensity in 16 bits, and whether nothing is lost by it. Where something is, 65535 is the full scale.
fn intensity(cloud: &PointCloud) -> (Vec<u16>, bool) {
    let is_exact = (cloud.full_scale == 255.0 || cloud.full_scale == 65535.0)
        && cloud.intensity.iter().all(|i| (0.0..=65535.0).contains(i) && i.fract() == 0.0);
    let scale = if is_exact { 1.0 } else { 65535.0 / cloud.full_scale };
    // `as` keeps within 0 to 65535 and makes NaN 0.
    (cloud.intensity.iter().map(|intensity| (intensity * scale).round() as u16).collect(), is_exact)
}

/// Byte 14: number of the return in the lower half, number of returns in the upper.
fn return_bytes(points: usize, number: Option<&[u8]>, of: Option<&[u8]>) -> Vec<u8> {
    let value = |column: Option<&[u8]>, i: usize| column.map_or(0, |column| column[i]);
    (0..points).map(|i| value(number, i) | (value(of, i) << 4)).collect()
}

/// Coordinates in steps.
fn steps(axis: &'static str, metres: &[f32]) -> Result<Vec<i32>, FormatError> {
    let one = |(point, &metres): (usize, &f32)| {
        let steps = (f64::from(metres) / STEP_M).round();
        // NaN is in no range.
        if (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&steps) {
            return Ok(steps as i32);
        }
        Err(FormatError::Unwritable {
            field: axis,
            point,
            value: format!("{metres} m"),
            format: "LAS",
            range: "finite coordinates within 214 km; drop the points without a return first",
        })
    };
    metres.iter().enumerate().map(one).collect()
}
