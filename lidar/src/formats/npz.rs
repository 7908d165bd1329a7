//! `NumPy`'s `.npz`: a ZIP archive of arrays.
//!
//! Read are, in this order: the array `points` (structured, or plain as in `.npy`), the array `xyz` `[point, 3]` or
//! `[ring, column, 3]`, the arrays `x`, `y`, `z`, or the only array there is. Every other array with as many values as there are
//! points is a column of its name. Labels are taken as the numbers they are. Written are `xyz` and one array a column, uncompressed.

use super::npy::{self, Array};
use super::number::Numbers;
use super::record::{self, FULL_SCALE_NOTE, Written};
use super::zip::{Archive, Writer};
use super::{FormatError, Limits};
use crate::PointCloud;
use crate::cloud::Column;

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<PointCloud, FormatError> {
    let mut archive = Archive::read(bytes)?;
    archive.entries.retain(|entry| entry.name.strip_suffix(".npy").is_some());
    let mut budget = limits.max_unpacked_bytes;
    archive.check_unpacked(budget)?;
    let mut members = Vec::new();
    for entry in &archive.entries {
        if let Some(name) = entry.name.strip_suffix(".npy") {
            let bytes = archive.unpack(entry, budget)?;
            budget -= bytes.len();
            members.push((name, bytes));
        }
    }
    let mut arrays = Vec::new();
    for (name, bytes) in &members {
        match Array::read(bytes) {
            Ok(array) => arrays.push((*name, array)),
            // Strings and the like beside the points do no harm.
            Err(error) if matches!(*name, "points" | "xyz" | "x" | "y" | "z") || members.len() == 1 => {
                return Err(error);
            }
            Err(_) => {}
        }
    }
    let named = |wanted: &str| arrays.iter().position(|(name, _)| *name == wanted);
    let base = named("points").or(named("xyz")).or(if arrays.len() == 1 { Some(0) } else { None });
    let full_scale = named(FULL_SCALE_NOTE).and_then(|i| scalar(&arrays[i].1));
    let (base, mut columns) = match (base, named("x")) {
        (Some(base), _) => (base, arrays[base].1.point_columns(limits)?),
        (None, Some(x)) => (x, Vec::new()),
        (None, None) => {
            let names: Vec<_> = arrays.iter().take(32).map(|(name, _)| *name).collect();
            return Err(FormatError::Missing { field: "points` or `xyz", present: names.join(", ") });
        }
    };
    let is_column = columns.is_empty();
    let array = &arrays[base].1;
    let shape = if is_column { array.shape() } else { array.point_shape() };
    for (i, (name, other)) in arrays.iter().enumerate() {
        if (is_column || i != base) && other.shape() == shape && *name != FULL_SCALE_NOTE {
            columns.extend(other.numbers().map(|values| Column { name: (*name).into(), values }));
        }
    }
    super::input::check_points(columns.first().map_or(0, |c| c.values.len() as u128), "shape", 0, limits)?;
    npy::organised(shape, columns, full_scale, limits)
}

/// The number of an array of one.
fn scalar(array: &Array<'_>) -> Option<f32> {
    let values = array.numbers()?.to_f64();
    let &[value] = values.as_slice() else { return None };
    (value.is_finite() && value > 0.0).then_some(value as f32)
}

pub(super) fn encode(cloud: &PointCloud) -> Result<Vec<u8>, FormatError> {
    let columns = record::written(cloud);
    let (xyz, others) = columns.split_at(3);
    let points = cloud.len();
    let mut archive = Writer::default();
    let header = npy::write_header("'<f4'", &format!("{points}, 3"))?;
    archive.add("xyz.npy", &record::append_records(header, xyz, points))?;
    let scale = [Written { name: FULL_SCALE_NOTE.into(), numbers: Numbers::F32(vec![cloud.full_scale].into()) }];
    for Written { name, numbers } in others.iter().chain(&scale) {
        let shape = if *name == FULL_SCALE_NOTE { String::new() } else { points.to_string() };
        let mut array = npy::write_header(&format!("'{}'", npy::descr(numbers.number_type())), &shape)?;
        array.extend(numbers.to_bytes());
        archive.add(&format!("{}.npy", member_name(name)), &array)?;
    }
    archive.finish()
}

/// A column's name as a file name inside an archive.
fn member_name(name: &str) -> String {
    record::word(name).replace(['/', '\\', ':'], "_")
}
