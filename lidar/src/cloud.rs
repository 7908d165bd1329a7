//! A point cloud: one column a field, all columns of one length.

use std::sync::Arc;

use thiserror::Error;

use crate::formats::RosMessage;

/// One scan's points in the sensor's frame: x ahead, y left, z up, in metres.
///
/// Every optional column, and every extra one, has as many values as `x`; [`PointCloud::check`] proves it and every reader calls it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Metres ahead of the sensor.
    pub x: Vec<f32>,
    /// Metres to the left of the sensor.
    pub y: Vec<f32>,
    /// Metres above the sensor.
    pub z: Vec<f32>,
    /// Intensity as measured or simulated, from 0 to [`full_scale`](Self::full_scale). All zero where the source has none.
    pub intensity: Vec<f32>,
    /// The intensity that means a reflectance of 1: 1 for KITTI and CARLA, 255 for 8-bit sensors, 65535 for LAS.
    pub full_scale: f32,
    /// Ring (laser) of each point, in the numbering of the source.
    pub ring: Option<Vec<u16>>,
    /// SemanticKITTI label: semantic id in the lower 16 bits, instance in the upper 16.
    pub label: Option<Vec<u32>>,
    /// Seconds; since the sweep's start where the source says so.
    pub time_s: Option<Vec<f64>>,
    /// Number of the return of its pulse: 1 is the first.
    pub return_number: Option<Vec<u8>>,
    /// Every other field of the source, in its order.
    pub extra: Vec<Column>,
    /// The ROS message that the cloud came in, without its points.
    pub ros: Option<Arc<RosMessage>>,
}

/// A field that the library gives no meaning to, carried along.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The field's name in the source.
    pub name: String,
    /// One value a point.
    pub values: Values,
}

/// The values of a [`Column`], in the number type of the source.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs)]
pub enum Values {
    I8(Vec<i8>),
    U8(Vec<u8>),
    I16(Vec<i16>),
    U16(Vec<u16>),
    I32(Vec<i32>),
    U32(Vec<u32>),
    I64(Vec<i64>),
    U64(Vec<u64>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

/// Applies one generic expression to the vector inside a [`Values`], whatever its type.
macro_rules! each_type {
    ($values:expr, $v:ident => $body:expr) => {
        match $values {
            Values::I8($v) => $body,
            Values::U8($v) => $body,
            Values::I16($v) => $body,
            Values::U16($v) => $body,
            Values::I32($v) => $body,
            Values::U32($v) => $body,
            Values::I64($v) => $body,
            Values::U64($v) => $body,
            Values::F32($v) => $body,
            Values::F64($v) => $body,
        }
    };
}

impl Values {
    /// Number of values.
    pub fn len(&self) -> usize {
        each_type!(self, v => v.len())
    }

    /// True without values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The values as `f64`; exact but for 64-bit integers past 2⁵³.
    // The macro's body serves every type, `f64` among them.
    #[allow(clippy::unnecessary_cast)]
    pub fn to_f64(&self) -> Vec<f64> {
        each_type!(self, v => v.iter().map(|&value| value as f64).collect())
    }

    /// Gives the column this length; values that nobody knows are 0 or, where the type has it, NaN.
    fn fill_up(&mut self, length: usize) {
        match self {
            Values::F32(values) => values.resize(length, f32::NAN),
            Values::F64(values) => values.resize(length, f64::NAN),
            whole => each_type!(whole, v => v.resize_with(length, Default::default)),
        }
    }

    /// Sets `self` to the values of `from` at `indices`, reusing the memory where the types agree.
    fn gather(&mut self, from: &Values, indices: &[u32]) {
        macro_rules! same_type {
            ($($kind:ident),*) => {
                match (&mut *self, from) {
                    $((Values::$kind(to), Values::$kind(from)) => gather(to, from, indices),)*
                    (to, from) => *to = each_type!(from, v => indices.iter().map(|&i| v[i as usize]).collect::<Vec<_>>().into()),
                }
            };
        }
        same_type!(I8, U8, I16, U16, I32, U32, I64, U64, F32, F64);
    }
}

macro_rules! values_from {
    ($($kind:ident $number:ty),*) => { $(impl From<Vec<$number>> for Values {
        fn from(values: Vec<$number>) -> Self { Values::$kind(values) }
    })* };
}
values_from!(I8 i8, U8 u8, I16 i16, U16 u16, I32 i32, U32 u32, I64 i64, U64 u64, F32 f32, F64 f64);

/// A cloud whose columns disagree.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("column `{column}` has {found} values where x has {expected}")]
pub struct ColumnLengthError {
    /// The column that differs.
    pub column: String,
    /// Values in `x`.
    pub expected: usize,
    /// Values in the column.
    pub found: usize,
}

impl PointCloud {
    /// An empty cloud whose intensities run to `full_scale`.
    pub fn new(full_scale: f32) -> Self {
        Self { full_scale, ..Self::default() }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// True without points.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Distance of point `i` from the sensor, in metres.
    pub fn range_m(&self, i: usize) -> f32 {
        let (x, y, z) = (self.x[i], self.y[i], self.z[i]);
        (x * x + y * y + z * z).sqrt()
    }

    /// Proves that every column is as long as `x`.
    pub fn check(&self) -> Result<(), ColumnLengthError> {
        let lengths = [("y", Some(self.y.len())), ("z", Some(self.z.len())), ("intensity", Some(self.intensity.len()))]
            .into_iter()
            .chain([
                ("ring", self.ring.as_ref().map(Vec::len)),
                ("label", self.label.as_ref().map(Vec::len)),
                ("time", self.time_s.as_ref().map(Vec::len)),
                ("return_number", self.return_number.as_ref().map(Vec::len)),
            ])
            .filter_map(|(name, length)| Some((name, length?)))
            .chain(self.extra.iter().map(|column| (column.name.as_str(), column.values.len())));
        for (column, found) in lengths {
            if found != self.len() {
                return Err(ColumnLengthError { column: column.into(), expected: self.len(), found });
            }
        }
        Ok(())
    }

    /// The points at `indices`, in that order, with all their fields.
    ///
    /// # Panics
    /// If an index is not a point of the cloud.
    #[must_use]
    pub fn select(&self, indices: &[u32]) -> Self {
        let mut out = Self::default();
        out.select_from(self, indices);
        out
    }

    /// [`select`](Self::select) into a cloud that is already there, reusing its memory.
    pub fn select_from(&mut self, from: &Self, indices: &[u32]) {
        gather(&mut self.x, &from.x, indices);
        gather(&mut self.y, &from.y, indices);
        gather(&mut self.z, &from.z, indices);
        gather(&mut self.intensity, &from.intensity, indices);
        self.select_rest_from(from, indices);
    }

    /// [`select_from`](Self::select_from) without place and intensity.
    pub(crate) fn select_rest_from(&mut self, from: &Self, indices: &[u32]) {
        self.full_scale = from.full_scale;
        gather_option(&mut self.ring, from.ring.as_deref(), indices);
        gather_option(&mut self.label, from.label.as_deref(), indices);
        gather_option(&mut self.time_s, from.time_s.as_deref(), indices);
        gather_option(&mut self.return_number, from.return_number.as_deref(), indices);
        self.ros.clone_from(&from.ros);
        self.extra.truncate(from.extra.len());
        for (i, column) in from.extra.iter().enumerate() {
            if i == self.extra.len() {
                self.extra.push(Column { name: String::new(), values: Values::U8(Vec::new()) });
            }
            self.extra[i].name.clone_from(&column.name);
            self.extra[i].values.gather(&column.values, indices);
        }
    }

    /// Gives points that were appended by place, intensity, ring and time what nothing is known of: no label, the first return of their
    /// pulse, and in the extra columns 0 or, for floats, NaN.
    pub(crate) fn fill_up(&mut self) {
        let points = self.len();
        if let Some(label) = &mut self.label {
            label.resize(points, 0);
        }
        if let Some(return_number) = &mut self.return_number {
            return_number.resize(points, 1);
        }
        for column in &mut self.extra {
            column.values.fill_up(points);
        }
    }

    /// Mirrors left and right: turns CARLA's left-handed frame (y to the right) into ours, and ours into CARLA's.
    pub fn mirror_y(&mut self) {
        for y in &mut self.y {
            *y = -*y;
        }
    }
}

fn gather<T: Copy>(to: &mut Vec<T>, from: &[T], indices: &[u32]) {
    to.clear();
    to.extend(indices.iter().map(|&i| from[i as usize]));
}

fn gather_option<T: Copy>(to: &mut Option<Vec<T>>, from: Option<&[T]>, indices: &[u32]) {
    match from {
        Some(from) => gather(to.get_or_insert_with(Vec::new), from, indices),
        None => *to = None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud() -> PointCloud {
        PointCloud {
            x: vec![1.0, 2.0, 3.0],
            y: vec![0.0; 3],
            z: vec![0.0; 3],
            intensity: vec![0.1, 0.2, 0.3],
            full_scale: 1.0,
            ring: Some(vec![7, 8, 9]),
            extra: vec![Column { name: "echo".into(), values: Values::I64(vec![-1, -2, -3]) }],
            ..PointCloud::default()
        }
    }

    #[test]
    fn selected_points_keep_all_their_fields() {
        let selected = cloud().select(&[2, 0]);
        assert_eq!(selected.x, [3.0, 1.0]);
        assert_eq!(selected.ring, Some(vec![9, 7]));
        assert_eq!(selected.extra[0].values, Values::I64(vec![-3, -1]));
        assert_eq!(selected.check(), Ok(()));
    }

    #[test]
    fn a_short_column_is_named() {
        let mut cloud = cloud();
        cloud.extra[0].values = Values::F32(vec![0.0]);
        assert_eq!(cloud.check().map_err(|e| e.to_string()), Err("column `echo` has 1 values where x has 3".into()));
    }

    #[test]
    fn selecting_into_a_used_cloud_forgets_what_was_there() {
        let mut target = PointCloud { time_s: Some(vec![1.0; 9]), ..cloud() };
        target.extra[0] = Column { name: "old".into(), values: Values::U8(vec![0; 9]) };
        target.select_from(&cloud(), &[1]);
        assert_eq!(target, cloud().select(&[1]));
    }
}
