//! The attributes of a LAS record that a cloud carries as extra columns, and where they lie in it.

use las::point::Format;

use crate::cloud::{Column, Values};
use crate::formats::meaning::are_seconds;
use crate::formats::number::Numbers;

pub(super) const CLASSIFICATION: &str = "las_classification";
pub(super) const NUMBER_OF_RETURNS: &str = "number_of_returns";
/// Bits as in formats 6–10: synthetic, key point, withheld, overlap, scanner channel (2), scan direction, edge of flight line.
pub(super) const FLAGS: &str = "las_flags";
pub(super) const SCAN_ANGLE: &str = "scan_angle_deg";
pub(super) const USER_DATA: &str = "user_data";
pub(super) const POINT_SOURCE: &str = "point_source_id";
pub(super) const GPS_TIME: &str = "gps_time";
pub(super) const COLOURS: [&str; 3] = ["red", "green", "blue"];
pub(super) const NIR: &str = "nir";

/// One step of the scan angle of formats 6–10, in degrees.
pub(super) const ANGLE_STEP_DEG: f32 = 0.006;

/// The flags of a record of any format, in the bits of formats 6–10.
pub(super) fn flags(record: &[u8], is_extended: bool) -> u8 {
    if is_extended { record[15] } else { (record[15] >> 5) | (record[14] & 0b1100_0000) }
}

/// What a cloud's extra columns put into the fields of records of format 6, 7 or 8; the others become extra bytes.
#[derive(Debug, Default)]
pub(super) struct Placed<'a> {
    /// Numbers and their offset in the record.
    pub(super) lanes: Vec<(Numbers<'a>, usize)>,
    pub(super) has_colour: bool,
    pub(super) has_nir: bool,
    pub(super) has_gps_time: bool,
    /// Indices of the columns that found a place.
    pub(super) columns: Vec<usize>,
    /// The upper half of byte 14.
    pub(super) number_of_returns: Option<&'a [u8]>,
}

impl<'a> Placed<'a> {
    /// Finds places. Only columns of the field's own type that would be read back as they are go there: `reads_gps_time` says
    /// whether our reader reads the GPS time of the file to be, `has_time` whether the cloud has a time of its own.
    pub(super) fn new(extra: &'a [Column], reads_gps_time: bool, has_time: bool) -> Self {
        let mut placed = Self::default();
        for (i, column) in extra.iter().enumerate() {
            if extra[..i].iter().any(|other| other.name == column.name) {
                continue;
            }
            let lane = match (column.name.as_str(), &column.values) {
                (CLASSIFICATION, Values::U8(values)) if any(values) => (Numbers::U8(values.into()), 16),
                (FLAGS, Values::U8(values)) if any(values) => (Numbers::U8(values.into()), 15),
                (USER_DATA, Values::U8(values)) if any(values) => (Numbers::U8(values.into()), 17),
                (POINT_SOURCE, Values::U16(values)) if any(values) => (Numbers::U16(values.into()), 20),
                (SCAN_ANGLE, Values::F32(values)) => match angle_steps(values) {
                    Some(steps) if any(&steps) => (Numbers::I16(steps.into()), 18),
                    _ => continue,
                },
                // Alone, plausible seconds would be read back as the cloud's time.
                (GPS_TIME, Values::F64(values))
                    if reads_gps_time && any(values) && (has_time || !are_seconds(values)) =>
                {
                    placed.has_gps_time = true;
                    (Numbers::F64(values.into()), 22)
                }
                (NUMBER_OF_RETURNS, Values::U8(values)) if any(values) && values.iter().all(|&n| n < 16) => {
                    placed.number_of_returns = Some(values);
                    placed.columns.push(i);
                    continue;
                }
                _ => continue,
            };
            placed.lanes.push(lane);
            placed.columns.push(i);
        }
        placed.place_colours(extra);
        placed
    }

    /// Colours go together: the format has all three or none.
    fn place_colours(&mut self, extra: &'a [Column]) {
        let find = |name: &str| {
            let i = extra.iter().position(|column| column.name == name)?;
            match &extra[i].values {
                Values::U16(values) => Some((i, values)),
                _ => None,
            }
        };
        let [Some(red), Some(green), Some(blue)] = COLOURS.map(find) else { return };
        self.has_colour = [red, green, blue].iter().any(|(_, values)| any(values));
        if !self.has_colour {
            return;
        }
        let nir = find(NIR).filter(|(_, values)| any(values));
        self.has_nir = nir.is_some();
        for ((i, values), offset) in [red, green, blue].into_iter().chain(nir).zip([30, 32, 34, 36]) {
            self.lanes.push((Numbers::U16(values.into()), offset));
            self.columns.push(i);
        }
    }

    /// The format whose records have all the places.
    pub(super) fn format(&self) -> Format {
        Format {
            has_gps_time: true,
            is_extended: true,
            has_color: self.has_colour,
            has_nir: self.has_nir,
            ..Format::default()
        }
    }
}

pub(super) fn any<T: Default + PartialEq>(values: &[T]) -> bool {
    values.iter().any(|value| *value != T::default())
}

/// The angles in steps of the format, where that loses nothing.
fn angle_steps(degrees: &[f32]) -> Option<Vec<i16>> {
    let steps = |&degrees: &f32| {
        let steps = (degrees / ANGLE_STEP_DEG).round() as i16;
        (f32::from(steps) * ANGLE_STEP_DEG == degrees).then_some(steps)
    };
    degrees.iter().map(steps).collect()
}
