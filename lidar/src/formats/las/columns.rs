//! The columns of a LAS file, gathered from some records at a time.

use las::PointDataBuilder;

use super::attributes::{self, any};
use super::{FormatError, Header, extra_bytes, library};
use crate::cloud::{Column, Values};
use crate::formats::meaning::{are_seconds, coordinates_m};

/// Columns that grow with each batch of records.
#[derive(Debug)]
pub(super) struct Columns<'a> {
    header: &'a Header,
    xyz: [Vec<f32>; 3],
    intensity: Vec<u16>,
    return_number: Vec<u8>,
    number_of_returns: Vec<u8>,
    classification: Vec<u8>,
    flags: Vec<u8>,
    scan_angle_deg: Vec<f32>,
    user_data: Vec<u8>,
    point_source: Vec<u16>,
    gps_time: Vec<f64>,
    colours: [Vec<u16>; 3],
    nir: Vec<u16>,
    extra: Vec<Column>,
}

impl<'a> Columns<'a> {
    pub(super) fn new(header: &'a Header) -> Self {
        Self {
            header,
            xyz: Default::default(),
            intensity: Vec::new(),
            return_number: Vec::new(),
            number_of_returns: Vec::new(),
            classification: Vec::new(),
            flags: Vec::new(),
            scan_angle_deg: Vec::new(),
            user_data: Vec::new(),
            point_source: Vec::new(),
            gps_time: Vec::new(),
            colours: Default::default(),
            nir: Vec::new(),
            extra: extra_bytes::empty_columns(&header.extra),
        }
    }

    /// Appends whole records.
    pub(super) fn append(&mut self, records: Vec<u8>) -> Result<(), FormatError> {
        let Header { format, transforms, record_bytes, .. } = self.header;
        let points = PointDataBuilder::new().with_format(*format).with_transforms(*transforms);
        let points = points.build_from_bytes(records).map_err(library)?;
        let first = self.intensity.len();
        self.xyz[0].append(&mut coordinates_m("x", points.x(), first)?);
        self.xyz[1].append(&mut coordinates_m("y", points.y(), first)?);
        self.xyz[2].append(&mut coordinates_m("z", points.z(), first)?);
        self.intensity.extend(points.intensity());
        self.return_number.extend(points.return_number());
        self.number_of_returns.extend(points.number_of_returns());
        self.classification.extend(points.classification());
        let records = points.raw_bytes();
        let flags = |record: &[u8]| attributes::flags(record, format.is_extended);
        self.flags.extend(records.chunks_exact(*record_bytes).map(flags));
        self.scan_angle_deg.extend(points.scan_angle_degrees());
        self.user_data.extend(points.user_data());
        self.point_source.extend(points.point_source_id());
        // The decompressor of layers leaves the time out, and the first point's in all others' place.
        if !(format.is_compressed && format.is_extended)
            && let Some(time) = points.gps_time()
        {
            self.gps_time.extend(time);
        }
        for (red, green, blue) in points.rgb().into_iter().flatten() {
            self.colours[0].push(red);
            self.colours[1].push(green);
            self.colours[2].push(blue);
        }
        if let Some(nir) = points.nir() {
            self.nir.extend(nir);
        }
        let extra_offset = record_bytes - usize::from(format.extra_bytes);
        extra_bytes::append(&mut self.extra, &self.header.extra, records, *record_bytes, extra_offset);
        Ok(())
    }

    /// All columns that say something, and the intensity that means 1.
    pub(super) fn finish(mut self) -> (Vec<Column>, f32) {
        extra_bytes::scale(&mut self.extra, &self.header.extra);
        let has_extra = |name: &str| self.extra.iter().any(|column| column.name.eq_ignore_ascii_case(name));
        let guess = if self.intensity.iter().all(|&intensity| intensity <= 255) { 255.0 } else { 65535.0 };
        let full_scale = self.header.full_scale.unwrap_or(guess);
        let is_copy = |column: &Column| {
            let Values::F64(time) = &column.values else { return false };
            column.name == "time" && time.iter().map(|t| t.to_bits()).eq(self.gps_time.iter().map(|t| t.to_bits()))
        };
        let has_gps_time = any(&self.gps_time) && !self.extra.iter().any(is_copy);
        let has_colour = self.colours.iter().any(|colour| any(colour));
        let is_time = !has_extra("time") && are_seconds(&self.gps_time);
        let gps_time = if is_time { "time" } else { attributes::GPS_TIME };
        let [x, y, z] = self.xyz;
        let [red, green, blue] = self.colours;
        let mut columns: Vec<Column> = Vec::new();
        let mut push = |name: &str, values: Values, is_wanted: bool| {
            if is_wanted {
                columns.push(Column { name: name.into(), values });
            }
        };
        push("x", x.into(), true);
        push("y", y.into(), true);
        push("z", z.into(), true);
        // Where we wrote the exact intensity beside the rounded one, the exact one is all there is to know.
        push("intensity", self.intensity.into(), !has_extra("intensity"));
        let is_wanted = any(&self.return_number) && !has_extra("return_number");
        push("return_number", self.return_number.into(), is_wanted);
        push(gps_time, self.gps_time.into(), has_gps_time);
        let is_wanted = any(&self.number_of_returns);
        push(attributes::NUMBER_OF_RETURNS, self.number_of_returns.into(), is_wanted);
        let is_wanted = any(&self.classification);
        push(attributes::CLASSIFICATION, self.classification.into(), is_wanted);
        let is_wanted = any(&self.flags);
        push(attributes::FLAGS, self.flags.into(), is_wanted);
        let is_wanted = any(&self.scan_angle_deg);
        push(attributes::SCAN_ANGLE, self.scan_angle_deg.into(), is_wanted);
        let is_wanted = any(&self.user_data);
        push(attributes::USER_DATA, self.user_data.into(), is_wanted);
        let is_wanted = any(&self.point_source);
        push(attributes::POINT_SOURCE, self.point_source.into(), is_wanted);
        for (name, colour) in attributes::COLOURS.into_iter().zip([red, green, blue]) {
            push(name, colour.into(), has_colour);
        }
        let is_wanted = any(&self.nir);
        push(attributes::NIR, self.nir.into(), is_wanted);
        columns.extend(self.extra);
        (columns, full_scale)
    }
}
