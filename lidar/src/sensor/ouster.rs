//! Ouster sensors, from the metadata that a sensor reports about itself.

use std::f64::consts::{PI, TAU};

use serde_json::Value;

use super::{MAX_RINGS, Ring, Sensor, SensorError};

/// Ranges by product line, in metres (data sheets: minimum range, and farthest at 80 % reflectance with room to spare).
const RANGE_M: [(&str, (f32, f32)); 3] = [("OS-0", (0.3, 120.0)), ("OS-1", (0.3, 300.0)), ("OS-2", (0.8, 500.0))];

impl Sensor {
    /// Reads the JSON metadata of an Ouster sensor, the flat layout of older firmware or the nested one of newer.
    ///
    /// Directions are those of Ouster's *sensor* frame (`lidar_to_sensor_transform` applied), column c being measurement id c; azimuth
    /// offsets are the lasers' true ones, so that a column is one firing. For pictures whose neighbours look in neighbouring directions
    /// see [`destaggered`](Self::destaggered).
    ///
    /// Source: Ouster Firmware User Manual, "Lidar Range to XYZ": a beam starts `lidar_origin_to_beam_origin_mm` from the spin axis in
    /// the direction of the encoder, and is turned from it by the beam's azimuth angle, clockwise.
    pub fn from_ouster_metadata(json: &str) -> Result<Self, SensorError> {
        let metadata: Value = serde_json::from_str(json).map_err(|error| SensorError::Malformed(error.to_string()))?;
        let name = text(&metadata, "sensor_info", "prod_line").unwrap_or("Ouster");
        let altitude_deg = list(&metadata, "beam_intrinsics", "beam_altitude_angles", name)?;
        let azimuth_deg = list(&metadata, "beam_intrinsics", "beam_azimuth_angles", name)?;
        if azimuth_deg.len() != altitude_deg.len() {
            let expected = format!("{}, as beam_altitude_angles has", altitude_deg.len());
            return Err(unexpected(name, "length of beam_azimuth_angles", &expected, &azimuth_deg.len()));
        }
        let (columns, rotation_hz) = mode(&metadata, name)?;
        let origin = find(&metadata, "beam_intrinsics", "lidar_origin_to_beam_origin_mm");
        let origin_m = origin.and_then(Value::as_f64).unwrap_or(0.0) / 1000.0;
        let (turned_rad, height_m) = mounting(&metadata, name)?;
        let half_column_rad = PI / columns as f64;
        let rings = altitude_deg.iter().zip(&azimuth_deg).map(|(altitude, azimuth)| {
            let (elevation_rad, aside_rad) = (altitude.to_radians(), azimuth.to_radians());
            // Column 0 looks along the lidar's own x axis; ours begins straight behind, its centre half a column on.
            let offset_rad = turned_rad - PI + half_column_rad - aside_rad;
            // The part of the beam's origin that lies across the beam is its distance beside the axis; the part along the beam, on
            // which elevation already rises, lowers the height at which the beam passes the axis.
            Ring {
                elevation_rad,
                azimuth_offset_rad: offset_rad - (offset_rad / TAU).round() * TAU,
                height_m: height_m - origin_m * aside_rad.cos() * elevation_rad.tan(),
                lateral_m: origin_m * aside_rad.sin(),
            }
        });
        let range_m =
            RANGE_M.iter().find(|(line, _)| name.starts_with(line)).map_or((0.1, 500.0), |(_, range_m)| *range_m);
        Self::new(name, rings.collect(), columns, range_m, rotation_hz)
    }
}

/// A value of the metadata: inside `group` in the nested layout, at the top in the flat one.
fn find<'a>(metadata: &'a Value, group: &str, key: &str) -> Option<&'a Value> {
    metadata.get(group).and_then(|group| group.get(key)).or_else(|| metadata.get(key))
}

fn text<'a>(metadata: &'a Value, group: &str, key: &str) -> Option<&'a str> {
    find(metadata, group, key).and_then(Value::as_str)
}

fn list(metadata: &Value, group: &str, key: &str, name: &str) -> Result<Vec<f64>, SensorError> {
    let Some(values) = find(metadata, group, key).and_then(Value::as_array) else {
        return Err(unexpected(name, key, "a list of angles in degrees", &"none"));
    };
    if values.len() > MAX_RINGS {
        return Err(unexpected(name, &format!("length of {key}"), &format!("at most {MAX_RINGS}"), &values.len()));
    }
    let number = |(i, value): (usize, &Value)| {
        value.as_f64().ok_or_else(|| unexpected(name, &format!("{key}[{i}]"), "an angle in degrees", value))
    };
    values.iter().enumerate().map(number).collect()
}

/// Columns and turns a second: `lidar_mode` is "1024x10".
fn mode(metadata: &Value, name: &str) -> Result<(usize, f32), SensorError> {
    let mode = text(metadata, "config_params", "lidar_mode").unwrap_or_default();
    let parsed = mode.split_once('x').and_then(|(columns, hz)| Some((columns.parse().ok()?, hz.parse().ok()?)));
    parsed.ok_or_else(|| {
        unexpected(name, "lidar_mode", "columns x turns a second, as in \"1024x10\"", &format!("{mode:?}"))
    })
}

/// Turn about the vertical, and height in metres, from the lidar's frame to the sensor's. Without one: half a turn, the factory's.
fn mounting(metadata: &Value, name: &str) -> Result<(f64, f64), SensorError> {
    const FIELD: &str = "lidar_to_sensor_transform";
    let Some(matrix) = find(metadata, "lidar_intrinsics", FIELD) else { return Ok((PI, 0.0)) };
    let numbers: Vec<f64> = matrix.as_array().into_iter().flatten().take(17).filter_map(Value::as_f64).collect();
    // Row by row; anything but a turn about the vertical and a lift would be no spinning sensor's frame.
    let upright = numbers.len() == 16
        && [2, 3, 6, 7, 8, 9].iter().all(|i| numbers[*i].abs() < 1e-6)
        && (numbers[10] - 1.0).abs() < 1e-6
        && (numbers[0].hypot(numbers[4]) - 1.0).abs() < 1e-6;
    if !upright {
        return Err(unexpected(name, FIELD, "4×4 numbers that turn about the vertical and lift", matrix));
    }
    Ok((numbers[4].atan2(numbers[0]), numbers[11] / 1000.0))
}

fn unexpected(name: &str, field: &str, expected: &str, found: &dyn ToString) -> SensorError {
    let found: String = found.to_string().chars().take(80).collect();
    SensorError::OutOfBounds { name: name.into(), field: field.into(), expected: expected.into(), found }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point of Ouster's own formula (Firmware User Manual, "Lidar Range to XYZ"), in the sensor's frame.
    fn ouster_point_m(range_m: f64, column: usize, altitude_deg: f64, azimuth_deg: f64) -> [f64; 3] {
        let encoder = TAU * (1.0 - column as f64 / 1024.0);
        let (azimuth, altitude, origin_m) = (-azimuth_deg.to_radians(), altitude_deg.to_radians(), 0.02767);
        let away_m = (range_m - origin_m) * altitude.cos();
        let x = away_m * (encoder + azimuth).cos() + origin_m * encoder.cos();
        let y = away_m * (encoder + azimuth).sin() + origin_m * encoder.sin();
        [-x, -y, (range_m - origin_m) * altitude.sin() + 0.03618]
    }

    const FLAT: &str = r#"{"beam_altitude_angles": [43.88, 0.72, -45.4], "beam_azimuth_angles": [-2.9, 3.1, -4.48],
        "lidar_mode": "1024x10", "lidar_origin_to_beam_origin_mm": 27.67, "prod_line": "OS-0-32-U1",
        "lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1]}"#;

    #[test]
    fn a_beam_passes_through_the_points_of_ousters_own_formula() -> Result<(), SensorError> {
        let sensor = Sensor::from_ouster_metadata(FLAT)?;
        assert_eq!((sensor.columns(), sensor.rotation_hz(), sensor.name.as_str()), (1024, 10.0, "OS-0-32-U1"));
        for (ring, (altitude, azimuth)) in [(43.88, -2.9), (0.72, 3.1), (-45.4, -4.48)].into_iter().enumerate() {
            for (column, reported_m) in [(0, 1.5), (300, 20.0), (1023, 80.0)] {
                let there = ouster_point_m(reported_m, column, altitude, azimuth);
                let range_m = there.iter().map(|v| v * v).sum::<f64>().sqrt();
                let here = sensor.point_m(ring, column, range_m);
                let error_m = here.iter().zip(&there).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                assert!(error_m < 1e-9, "ring {ring}, column {column}: {error_m} m");
            }
        }
        Ok(())
    }

    #[test]
    fn the_nested_layout_says_the_same() -> Result<(), SensorError> {
        let nested = r#"{"beam_intrinsics": {"beam_altitude_angles": [43.88, 0.72, -45.4], "beam_azimuth_angles": [-2.9, 3.1, -4.48],
            "lidar_origin_to_beam_origin_mm": 27.67}, "config_params": {"lidar_mode": "1024x10"},
            "sensor_info": {"prod_line": "OS-0-32-U1"},
            "lidar_intrinsics": {"lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1]}}"#;
        assert_eq!(Sensor::from_ouster_metadata(nested)?, Sensor::from_ouster_metadata(FLAT)?);
        Ok(())
    }

    #[test]
    fn broken_metadata_is_refused_by_name_of_the_field() {
        let error = |from: &str, to: &str| match Sensor::from_ouster_metadata(&FLAT.replace(from, to)) {
            Ok(_) => String::new(),
            Err(error) => error.to_string(),
        };
        assert!(error("1024x10", "fast").contains("lidar_mode is \"fast\""));
        assert!(error("1024x10", "999999999x10").contains("columns is 999999999"));
        assert!(error("43.88, 0.72", "43.88").contains("length of beam_azimuth_angles is 3"));
        assert!(error("43.88", "\"up\"").contains("beam_altitude_angles[0]"));
        assert!(error("43.88", "90").contains("elevation_deg[0]"));
        assert!(error("[-1, 0, 0, 0, 0, -1", "[1, 0, 0, 9, 0, 1").contains("lidar_to_sensor_transform"));
        assert!(error("27.67", "1e9").contains("lateral_m") || error("27.67", "1e9").contains("height_m"));
        assert!(error("\"prod_line\"", "").contains("sensor description"));
        assert!(Sensor::from_ouster_metadata(&"[".repeat(100_000)).is_err());
        assert!(Sensor::from_ouster_metadata("{}").is_err_and(|e| e.to_string().contains("beam_altitude_angles")));
    }

    #[test]
    fn destaggered_columns_look_where_their_number_says() -> Result<(), SensorError> {
        let sensor = Sensor::from_ouster_metadata(FLAT)?;
        let straight = sensor.clone().destaggered();
        let column_rad = TAU / 1024.0;
        for (ring, (before, after)) in sensor.rings().iter().zip(straight.rings()).enumerate() {
            assert!(after.azimuth_offset_rad.abs() <= 0.5 * column_rad + 1e-12, "ring {ring}");
            let columns = (before.azimuth_offset_rad - after.azimuth_offset_rad) / column_rad;
            assert!(
                (columns - columns.round()).abs() < 1e-9,
                "whole columns only, or the rays would change: {columns}"
            );
        }
        Ok(())
    }
}
