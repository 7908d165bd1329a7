//! An NPY array in memory, and the columns of points in it.

use super::header::Header;
use super::{FormatError, Limits};
use crate::cloud::{Column, Values};
use crate::formats::input::{check_points, truncated};
use crate::formats::number::{Lane, column};
use crate::formats::record;

/// Columns of a plain array, by their number. Other layouts are ambiguous.
const XYZ: [&str; 3] = ["x", "y", "z"];
/// `SqueezeSeg`'s layout, known by its fifth column: it is the range.
const SQUEEZE_SEG: [&str; 6] = ["x", "y", "z", "intensity", "range_m", "label"];

/// An array whose shape fits its bytes.
#[derive(Clone, Debug)]
pub(in crate::formats) struct Array<'a> {
    header: Header,
    shape: Vec<usize>,
    body: &'a [u8],
}

impl<'a> Array<'a> {
    /// Reads an array without copying it.
    pub(in crate::formats) fn read(bytes: &'a [u8]) -> Result<Self, FormatError> {
        let header = Header::read(bytes)?;
        let stride = record::record_bytes(&header.fields, "descr", header.shape_offset)?;
        let body = &bytes[header.body_offset..];
        let length = header.shape.iter().try_fold(stride as u128, |a, &b| a.checked_mul(b)).unwrap_or(u128::MAX);
        if length > body.len() as u128 {
            return Err(truncated("shape", header.shape_offset, length, body.len()));
        }
        // A length of zero hides any other number beside it.
        let fits = |&length: &u128| usize::try_from(length).ok().filter(|&length| length <= usize::MAX >> 8);
        let shape: Option<Vec<usize>> = header.shape.iter().map(fits).collect();
        let shape = shape.ok_or_else(|| {
            FormatError::field("shape", header.shape_offset, "lengths", format!("{:?}", header.shape))
        })?;
        Ok(Self { header, shape, body: &body[..length as usize] })
    }

    /// The array's lengths without the axis of a plain array's columns: `[point]`, or `[ring, column]` of a range image.
    pub(in crate::formats) fn point_shape(&self) -> &[usize] {
        if self.header.is_structured { &self.shape } else { &self.shape[..self.shape.len().saturating_sub(1)] }
    }

    /// All lengths.
    pub(in crate::formats) fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// The columns of an array of points: the named fields, or x, y, z, intensity, ring by their place.
    pub(in crate::formats) fn point_columns(&self, limits: &Limits) -> Result<Vec<Column>, FormatError> {
        let dimensions = self.point_shape();
        if dimensions.is_empty() || dimensions.len() > 2 {
            let what = format!("an array of shape {:?} as points", self.shape);
            return Err(FormatError::Unsupported {
                what,
                hint: Some("give one scan: [point], [point, 3…6] or [ring, column, 3…6]"),
            });
        }
        let points = dimensions.iter().try_fold(1_u128, |a, &b| a.checked_mul(b as u128)).unwrap_or(u128::MAX);
        let points = check_points(points, "shape", self.header.shape_offset, limits)?;
        self.check_order()?;
        if !self.header.is_structured {
            return self.plain_columns(points);
        }
        let mut columns = record::columns(&self.header.fields, self.body, self.header.endian);
        record::drop_padding(&mut columns);
        Ok(columns)
    }

    /// All numbers of a plain array, or `None` for a structured one.
    pub(in crate::formats) fn numbers(&self) -> Option<Values> {
        if self.header.is_structured || self.check_order().is_err() {
            return None;
        }
        let number_type = self.header.fields[0].number_type;
        let lane = Lane { stride: number_type.bytes(), offset: 0, endian: self.header.endian };
        Some(column(number_type, self.body, lane))
    }

    /// Points in Fortran's order are columns one after the other; with more axes the points themselves come in another order.
    fn check_order(&self) -> Result<(), FormatError> {
        if self.header.is_fortran && self.shape.len() > 2 {
            let what = format!("an array of shape {:?} in Fortran's order", self.shape);
            return Err(FormatError::Unsupported { what, hint: Some("save numpy.ascontiguousarray of it") });
        }
        Ok(())
    }

    fn plain_columns(&self, points: usize) -> Result<Vec<Column>, FormatError> {
        let number_type = self.header.fields[0].number_type;
        let bytes = number_type.bytes();
        let width = self.shape.last().copied().unwrap_or(0);
        if !(3..=6).contains(&width) || self.header.fields[0].count != 1 {
            let what = format!("an array of shape {:?} as points", self.shape);
            return Err(FormatError::Unsupported { what, hint: Some("name the columns: save a structured array") });
        }
        let values = |i: usize| {
            if self.header.is_fortran {
                let lane = Lane { stride: bytes, offset: 0, endian: self.header.endian };
                column(number_type, &self.body[i * points * bytes..(i + 1) * points * bytes], lane)
            } else {
                let lane = Lane { stride: width * bytes, offset: i * bytes, endian: self.header.endian };
                column(number_type, self.body, lane)
            }
        };
        let columns: Vec<Values> = (0..width).map(values).collect();
        let names: Vec<&str> = match width {
            3 => XYZ.to_vec(),
            4 => SQUEEZE_SEG[..4].to_vec(),
            // KITTI, nuScenes and their many followers put the ring here, or the sweep's age, which is no whole number.
            5 => [&SQUEEZE_SEG[..4], &["ring"]].concat(),
            _ if is_range(&columns) => SQUEEZE_SEG.to_vec(),
            _ => {
                let what = "a plain array of six columns whose fifth is not the range";
                let hint = Some("name the columns: save a structured array");
                return Err(FormatError::Unsupported { what: what.into(), hint });
            }
        };
        Ok(names.iter().zip(columns).map(|(name, values)| Column { name: (*name).into(), values }).collect())
    }
}

/// True where the fifth column is the length of the first three.
fn is_range(columns: &[Values]) -> bool {
    let [x, y, z, range] = [0, 1, 2, 4].map(|i| columns[i].to_f64());
    let norm = |i: usize| (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt();
    // A centimetre is the step of the coarsest recordings.
    (0..range.len()).all(|i| (norm(i) - range[i]).abs() < 0.01)
}
