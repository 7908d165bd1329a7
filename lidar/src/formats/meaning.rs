//! Which of a file's columns means what: from named columns to a cloud.

use super::number::{NumberType, Numbers};
use super::{FormatError, Limits, carla};
use crate::PointCloud;
use crate::cloud::{Column, Values};

/// Names of each field in the wild, lower case; the first one present is taken, the others stay extra columns.
const INTENSITY: &[&str] = &["intensity", "reflectance", "reflectivity", "remission", "i"];
const RING: &[&str] = &["ring", "channel", "laser_id", "row"];
const LABEL: &[&str] = &["label", "semantic", "class", "classification"];
const TIME: &[&str] = &["time", "time_s", "t", "timestamp", "time_stamp"];
// `return_type` is not here: its numbers (Nebula, Autoware) are an enumeration of modes, not the place in the pulse.
const RETURN_NUMBER: &[&str] = &["return_number", "return"];

/// Nanoseconds a second.
const NANOSECONDS: f64 = 1e9;

/// Past this distance neighbouring `f32` are more than a millimetre apart.
const MILLIMETRE_RANGE_M: f64 = 16_384.0;
/// Past this one a number is no place on Earth but a marker for a missing point.
const PLACE_RANGE_M: f64 = 1e8;

/// Makes a cloud of named columns.
///
/// `full_scale` is the file's word on the intensity that means 1. Without it the number type decides: 255 for 8 bits, 65535 for 16;
/// other numbers mean 1, 255 or 65535, the least that holds their maximum.
pub(super) fn cloud_of(
    columns: Vec<Column>,
    full_scale: Option<f32>,
    limits: &Limits,
) -> Result<PointCloud, FormatError> {
    let mut columns = Columns(columns);
    let [x, y, z] = ["x", "y", "z"].map(|axis| columns.coordinate(axis));
    let (x, y, z) = (x?, y?, z?);
    let intensity = columns.take(INTENSITY, |values| Some((to_f32(values), guess_full_scale(values))));
    let (intensity, guess) = intensity.unwrap_or_else(|| (vec![0.0; x.len()], 1.0));
    let mut cloud = PointCloud {
        intensity,
        full_scale: full_scale.unwrap_or(guess),
        ring: columns.take(RING, |values| whole(values, f64::from(u16::MAX), |v| v as u16)),
        label: columns.take(LABEL, |values| whole(values, f64::from(u32::MAX), |v| v as u32)),
        return_number: columns.take(RETURN_NUMBER, |values| whole(values, f64::from(u8::MAX), |v| v as u8)),
        x,
        y,
        z,
        ..PointCloud::default()
    };
    if let Some((i, seconds)) = columns.find(TIME, seconds) {
        if is_recoverable(&columns.0[i].values, &seconds) {
            columns.0.remove(i);
        }
        cloud.time_s = Some(seconds);
    }
    cloud.extra = columns.0;
    carla::label_by_tag(&mut cloud, limits.carla_tags);
    Ok(cloud)
}

/// What reading took out of a file's column of this name, for a file to be written with the same column of this type. Integer times
/// are nanoseconds, as they are read.
pub(super) fn named<'a>(cloud: &'a PointCloud, name: &str, number_type: NumberType) -> Option<Numbers<'a>> {
    let is = |names: &[&str]| names.iter().any(|known| known.eq_ignore_ascii_case(name));
    if is(&["x"]) {
        Some(Numbers::F32((&cloud.x).into()))
    } else if is(&["y"]) {
        Some(Numbers::F32((&cloud.y).into()))
    } else if is(&["z"]) {
        Some(Numbers::F32((&cloud.z).into()))
    } else if is(INTENSITY) {
        Some(Numbers::F32((&cloud.intensity).into()))
    } else if is(RING) {
        cloud.ring.as_ref().map(|ring| Numbers::U16(ring.into()))
    } else if is(LABEL) {
        cloud.label.as_ref().map(|label| Numbers::U32(label.into()))
    } else if is(RETURN_NUMBER) {
        cloud.return_number.as_ref().map(|number| Numbers::U8(number.into()))
    } else if is(TIME) {
        let seconds = cloud.time_s.as_ref()?;
        let is_float = matches!(number_type, NumberType::F32 | NumberType::F64);
        let nanoseconds = || seconds.iter().map(|time_s| time_s * NANOSECONDS).collect::<Vec<_>>();
        Some(Numbers::F64(if is_float { seconds.into() } else { nanoseconds().into() }))
    } else {
        None
    }
}

/// The columns of a file that have no meaning yet.
struct Columns(Vec<Column>);

impl Columns {
    /// The first column with one of these names, the earlier name first, if `convert` accepts its values.
    fn find<T>(&self, names: &[&str], convert: impl Fn(&Values) -> Option<T>) -> Option<(usize, T)> {
        let named = |name: &&str| self.0.iter().position(|column| column.name.eq_ignore_ascii_case(name));
        let i = names.iter().find_map(named)?;
        convert(&self.0[i].values).map(|converted| (i, converted))
    }

    /// Takes what [`find`](Self::find) finds out of the columns.
    fn take<T>(&mut self, names: &[&str], convert: impl Fn(&Values) -> Option<T>) -> Option<T> {
        let (i, converted) = self.find(names, convert)?;
        self.0.remove(i);
        Some(converted)
    }

    fn coordinate(&mut self, axis: &'static str) -> Result<Vec<f32>, FormatError> {
        let Some(i) = self.0.iter().position(|column| column.name.eq_ignore_ascii_case(axis)) else {
            let present: Vec<_> = self.0.iter().take(32).map(|column| column.name.as_str()).collect();
            return Err(FormatError::Missing { field: axis, present: present.join(", ") });
        };
        match self.0.remove(i).values {
            Values::F32(metres) => Ok(metres),
            Values::F64(metres) => coordinates_m(axis, metres.into_iter(), 0),
            integers => Ok(to_f32(&integers)),
        }
    }
}

/// Coordinates as `f32`, refused where that would lose a millimetre (UTM and other map coordinates). `first` is the index of the
/// first one's point.
pub(super) fn coordinates_m(
    field: &'static str,
    metres: impl Iterator<Item = f64>,
    first: usize,
) -> Result<Vec<f32>, FormatError> {
    let mut coordinates = Vec::with_capacity(metres.size_hint().0);
    for (i, value_m) in metres.enumerate() {
        let far = (MILLIMETRE_RANGE_M..PLACE_RANGE_M).contains(&value_m.abs());
        if far && (f64::from(value_m as f32) - value_m).abs() > 0.5e-3 {
            return Err(FormatError::FarFromOrigin { field, point: first + i, value_m });
        }
        coordinates.push(value_m as f32);
    }
    Ok(coordinates)
}

fn to_f32(values: &Values) -> Vec<f32> {
    match values {
        Values::F32(values) => values.clone(),
        Values::U8(values) => values.iter().map(|&v| f32::from(v)).collect(),
        Values::U16(values) => values.iter().map(|&v| f32::from(v)).collect(),
        others => others.to_f64().into_iter().map(|v| v as f32).collect(),
    }
}

fn guess_full_scale(intensity: &Values) -> f32 {
    match intensity {
        Values::U8(_) => 255.0,
        Values::U16(_) => 65535.0,
        others => match others.to_f64().into_iter().fold(0.0, f64::max) {
            ..=1.0 if matches!(others, Values::F32(_) | Values::F64(_)) => 1.0,
            ..=255.0 => 255.0,
            _ => 65535.0,
        },
    }
}

/// The values as integers, where all of them are whole and from 0 to `max`.
fn whole<T>(values: &Values, max: f64, integer: fn(f64) -> T) -> Option<Vec<T>> {
    let values = values.to_f64();
    let all_fit = values.iter().all(|value| (0.0..=max).contains(value) && value.fract() == 0.0);
    all_fit.then(|| values.into_iter().map(integer).collect())
}

/// Times as seconds. Floats are seconds unless they are too large for that. Integers are nanoseconds (Ouster, Nebula, ROS) if
/// that makes a sweep of 10 ms to 10 s; otherwise their unit is anybody's guess and they stay an extra column.
fn seconds(times: &Values) -> Option<Vec<f64>> {
    let values = times.to_f64();
    let finite = || values.iter().copied().filter(|time| time.is_finite());
    let (first, last) = finite().fold((f64::MAX, f64::MIN), |(first, last), time| (first.min(time), last.max(time)));
    if matches!(times, Values::F32(_) | Values::F64(_)) {
        return are_seconds(&values).then_some(values);
    }
    (1e7..=1e10).contains(&(last - first)).then(|| values.iter().map(|time| time / NANOSECONDS).collect())
}

/// True where floats are small enough to be seconds, if only since 1970.
pub(super) fn are_seconds(times: &[f64]) -> bool {
    times.iter().filter(|time| time.is_finite()).all(|time| time.abs() < 1e10)
}

/// True where the times in the file can be told from the seconds: not so for 64-bit nanoseconds since 1970.
fn is_recoverable(times: &Values, seconds: &[f64]) -> bool {
    let same = |(nanoseconds, seconds): (i128, &f64)| (seconds * NANOSECONDS).round() as i128 == nanoseconds;
    match times {
        Values::I64(times) => times.iter().map(|&t| i128::from(t)).zip(seconds).all(same),
        Values::U64(times) => times.iter().map(|&t| i128::from(t)).zip(seconds).all(same),
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(name: &str, values: impl Into<Values>) -> Column {
        Column { name: name.into(), values: values.into() }
    }

    fn with(columns: impl IntoIterator<Item = Column>) -> Result<PointCloud, FormatError> {
        let xyz = ["X", "y", "z"].map(|name| column(name, vec![1.0_f32, 2.0]));
        cloud_of(xyz.into_iter().chain(columns).collect(), None, &Limits::default())
    }

    #[test]
    fn the_number_type_says_which_intensity_is_full() -> Result<(), FormatError> {
        for (values, full_scale) in [
            (Values::U8(vec![1, 0]), 255.0),
            (Values::U16(vec![1, 0]), 65535.0),
            (Values::I32(vec![1, 0]), 255.0),
            (Values::F32(vec![1.0, 0.0]), 1.0),
            (Values::F64(vec![1.5, 0.0]), 255.0),
            (Values::F32(vec![256.0, 0.0]), 65535.0),
        ] {
            assert_eq!(with([column("Reflectivity", values.clone())])?.full_scale, full_scale, "{values:?}");
        }
        Ok(())
    }

    #[test]
    fn the_better_name_wins_and_the_other_stays() -> Result<(), FormatError> {
        let cloud = with([column("channel", vec![3_i32, 4]), column("ring", vec![1.0_f32, 2.0])])?;
        assert_eq!(cloud.ring, Some(vec![1, 2]));
        assert_eq!(cloud.extra, [column("channel", vec![3_i32, 4])]);
        Ok(())
    }

    #[test]
    fn numbers_that_are_no_rings_stay_what_they_are() -> Result<(), FormatError> {
        for odd in [-1.0, 0.5, 65536.0, f32::NAN] {
            let cloud = with([column("ring", vec![0.0, odd])])?;
            assert!(cloud.ring.is_none() && cloud.extra.len() == 1, "{odd}");
        }
        Ok(())
    }

    #[test]
    fn a_sweep_in_nanoseconds_becomes_seconds() -> Result<(), FormatError> {
        let cloud = with([column("t", vec![0_u32, 99_999_744])])?;
        assert_eq!((cloud.time_s, cloud.extra.len()), (Some(vec![0.0, 0.099_999_744]), 0));
        let raw = vec![1_700_000_000_000_000_001_u64, 1_700_000_000_100_000_001];
        let cloud = with([column("timestamp", raw.clone())])?;
        assert!(cloud.time_s.is_some());
        assert_eq!(cloud.extra, [column("timestamp", raw)], "seconds alone would lose the last digits");
        Ok(())
    }

    #[test]
    fn times_of_no_known_unit_are_no_seconds() -> Result<(), FormatError> {
        for values in [Values::U32(vec![5, 6]), Values::F64(vec![1.7e18, 1.7e18])] {
            let cloud = with([column("timestamp", values)])?;
            assert!(cloud.time_s.is_none() && cloud.extra.len() == 1);
        }
        Ok(())
    }

    #[test]
    fn map_coordinates_are_refused_and_markers_are_not() {
        let east_m = column("x", vec![333_000.123_f64, 333_001.456]);
        let others = || ["y", "z"].map(|name| column(name, vec![0.0_f64, 1e30]));
        let refused = cloud_of([east_m].into_iter().chain(others()).collect(), None, &Limits::default());
        assert!(matches!(refused, Err(FormatError::FarFromOrigin { field: "x", point: 0, .. })));
        let near = column("x", vec![1.0_f64, f64::NAN]);
        assert!(cloud_of([near].into_iter().chain(others()).collect(), None, &Limits::default()).is_ok());
    }

    #[test]
    fn a_missing_axis_is_named_beside_what_is_there() {
        let error = cloud_of(vec![column("x", vec![0_u8]), column("up", vec![0_u8])], None, &Limits::default());
        assert_eq!(error.map_err(|e| e.to_string()).err().as_deref(), Some("no field `y`; the file has: up"));
    }

    #[test]
    fn tags_of_a_saved_carla_scan_become_labels() -> Result<(), FormatError> {
        let cloud = with([column("ObjIdx", vec![7_u32, 0]), column("ObjTag", vec![14_u32, 1])])?;
        assert_eq!(cloud.label, Some(vec![0x0007_000a, 40]));
        assert_eq!(cloud.extra.len(), 2);
        Ok(())
    }
}
