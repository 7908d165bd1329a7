//! A spinning lidar's geometry: where each ring looks, how many columns make a turn, how far it sees.

mod builtin;
mod carla;
pub mod estimate;
mod ouster;

pub use builtin::BUILTIN;

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Most rings and columns that a sensor may have: bounds every image that is made for it.
pub const MAX_RINGS: usize = 1024;
/// See [`MAX_RINGS`].
pub const MAX_COLUMNS: usize = 16_384;

/// A spinning lidar. One that exists has at least one ring and only finite, sensible numbers.
///
/// Pixel (ring, column) looks along azimuth π − (column + ½)·2π/columns + the ring's azimuth offset: column 0 begins straight behind
/// the sensor, columns turn clockwise seen from above, straight ahead is the middle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SensorFile", into = "SensorFile")]
pub struct Sensor {
    /// Human-readable name.
    pub name: String,
    rings: Vec<Ring>,
    columns: usize,
    range_min_m: f32,
    range_max_m: f32,
    rotation_hz: f32,
}

/// One laser of a spinning lidar.
///
/// Its beam passes the spin axis `height_m` above the origin and `lateral_m` beside it: a return at horizontal distance d has
/// z = √(d² − lateral²)·tan(elevation) + height and azimuth = encoder azimuth + offset + asin(lateral / d).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ring {
    /// Angle above the horizontal plane.
    pub elevation_rad: f64,
    /// Angle by which the ring's columns are turned to the left of the encoder's.
    pub azimuth_offset_rad: f64,
    /// Height of the beam's origin above the sensor's, on the spin axis.
    pub height_m: f64,
    /// Distance of the beam from the spin axis.
    pub lateral_m: f64,
}

/// A sensor description that cannot be.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SensorError {
    /// A number is outside what a lidar can have.
    #[error("sensor `{name}`: {field} is {found}, expected {expected}")]
    OutOfBounds {
        /// The sensor's name.
        name: String,
        /// Field of the description.
        field: String,
        /// What it may be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// The text is no description at all.
    #[error("sensor description: {0}")]
    Malformed(String),
    /// No built-in sensor has this name.
    #[error("no built-in sensor is called `{name}`; there are {known}")]
    Unknown {
        /// The name asked for.
        name: String,
        /// Names that there are.
        known: String,
    },
}

/// The TOML and JSON form of a [`Sensor`]: angles in degrees, one value a ring; lists that are left out are zero.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorFile {
    name: String,
    columns: usize,
    range_min_m: f32,
    range_max_m: f32,
    rotation_hz: f32,
    elevation_deg: Vec<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    azimuth_offset_deg: Vec<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    height_m: Vec<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    lateral_m: Vec<f64>,
}

impl Sensor {
    /// A sensor of these rings (the first one is ring 0, by convention the topmost) that sees from `range_m.0` to `range_m.1` metres.
    pub fn new(
        name: &str,
        rings: Vec<Ring>,
        columns: usize,
        range_m: (f32, f32),
        rotation_hz: f32,
    ) -> Result<Self, SensorError> {
        let sensor =
            Self { name: name.into(), rings, columns, range_min_m: range_m.0, range_max_m: range_m.1, rotation_hz };
        sensor.check()?;
        Ok(sensor)
    }

    /// A sensor whose rings differ in elevation alone.
    pub fn from_elevations_deg(
        name: &str,
        elevation_deg: impl IntoIterator<Item = f64>,
        columns: usize,
        range_m: (f32, f32),
        rotation_hz: f32,
    ) -> Result<Self, SensorError> {
        let rings = elevation_deg.into_iter().map(|e| Ring { elevation_rad: e.to_radians(), ..Ring::default() });
        Self::new(name, rings.collect(), columns, range_m, rotation_hz)
    }

    /// Reads the TOML form: `name`, `columns`, `range_min_m`, `range_max_m`, `rotation_hz`, `elevation_deg = [one a ring]` and
    /// optionally `azimuth_offset_deg`, `height_m`, `lateral_m`.
    pub fn from_toml(text: &str) -> Result<Self, SensorError> {
        toml::from_str(text).map_err(|error| SensorError::Malformed(error.to_string()))
    }

    /// The TOML form that [`from_toml`](Self::from_toml) reads.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_else(|_| unreachable!("a sensor is plain numbers and strings"))
    }

    /// The same sensor with another number of columns a turn.
    pub fn with_columns(mut self, columns: usize) -> Result<Self, SensorError> {
        self.columns = columns;
        self.check()?;
        Ok(self)
    }

    /// The same rays with every ring's columns renumbered, so that azimuth offsets are at most half a column and neighbouring pixels
    /// look in neighbouring directions. A column is then no longer one firing.
    #[must_use]
    pub fn destaggered(mut self) -> Self {
        let column_rad = TAU / self.columns as f64;
        for ring in &mut self.rings {
            ring.azimuth_offset_rad -= (ring.azimuth_offset_rad / column_rad).round() * column_rad;
        }
        self
    }

    /// The lasers, ring 0 first.
    pub fn rings(&self) -> &[Ring] {
        &self.rings
    }

    /// Columns a turn.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Pixels of a whole turn.
    pub fn pixels(&self) -> usize {
        self.rings.len() * self.columns
    }

    /// Nearest and farthest range that the sensor reports, in metres.
    pub fn range_limits_m(&self) -> (f32, f32) {
        (self.range_min_m, self.range_max_m)
    }

    /// Turns a second.
    pub fn rotation_hz(&self) -> f32 {
        self.rotation_hz
    }

    /// Encoder azimuth of a column's centre, in (−π, π): 0 is straight ahead, positive to the left. Add the ring's offset.
    pub fn azimuth_rad(&self, column: usize) -> f64 {
        PI - (column as f64 + 0.5) * TAU / self.columns as f64
    }

    /// Unit vector along which pixel (ring, column) looks, from the sensor's origin; the beam's own small offsets left out.
    pub fn direction(&self, ring: usize, column: usize) -> [f64; 3] {
        let beam = &self.rings[ring];
        let azimuth = self.azimuth_rad(column) + beam.azimuth_offset_rad;
        let (sin_e, cos_e) = beam.elevation_rad.sin_cos();
        [cos_e * azimuth.cos(), cos_e * azimuth.sin(), sin_e]
    }

    /// Origin of the beam of pixel (ring, column), in metres in the sensor's frame.
    pub fn origin_m(&self, ring: usize, column: usize) -> [f64; 3] {
        let beam = &self.rings[ring];
        let azimuth = self.azimuth_rad(column) + beam.azimuth_offset_rad;
        [-beam.lateral_m * azimuth.sin(), beam.lateral_m * azimuth.cos(), beam.height_m]
    }

    /// The point on the beam of pixel (ring, column) at this range from the sensor's origin, in metres in the sensor's frame.
    pub fn point_m(&self, ring: usize, column: usize, range_m: f64) -> [f64; 3] {
        let (origin, direction) = (self.origin_m(ring, column), self.direction(ring, column));
        // |origin + t·direction| = range, solved for the larger t.
        let along: f64 = origin.iter().zip(&direction).map(|(o, d)| o * d).sum();
        let away: f64 = origin.iter().map(|o| o * o).sum();
        let t = (along * along - away + range_m * range_m).max(0.0).sqrt() - along;
        std::array::from_fn(|i| origin[i] + t * direction[i])
    }

    fn check(&self) -> Result<(), SensorError> {
        let fail = |field: String, expected: &str, found: String| {
            Err(SensorError::OutOfBounds { name: self.name.clone(), field, expected: expected.into(), found })
        };
        if self.rings.is_empty() || self.rings.len() > MAX_RINGS {
            return fail("number of rings".into(), &format!("1 to {MAX_RINGS}"), self.rings.len().to_string());
        }
        if !(8..=MAX_COLUMNS).contains(&self.columns) {
            return fail("columns".into(), &format!("8 to {MAX_COLUMNS}"), self.columns.to_string());
        }
        if !(self.range_min_m >= 0.0 && self.range_min_m < self.range_max_m && self.range_max_m <= 10_000.0) {
            let found = format!("{} to {}", self.range_min_m, self.range_max_m);
            return fail("range_min_m to range_max_m".into(), "0 ≤ minimum < maximum ≤ 10000", found);
        }
        if !(self.rotation_hz > 0.0 && self.rotation_hz <= 1000.0) {
            return fail("rotation_hz".into(), "above 0, at most 1000", self.rotation_hz.to_string());
        }
        for (i, ring) in self.rings.iter().enumerate() {
            if ring.elevation_rad.is_nan() || ring.elevation_rad.abs() >= PI / 2.0 {
                let found = format!("{}", ring.elevation_rad.to_degrees());
                return fail(format!("elevation_deg[{i}]"), "between −90 and 90", found);
            }
            if ring.azimuth_offset_rad.is_nan() || ring.azimuth_offset_rad.abs() > TAU {
                let found = format!("{}", ring.azimuth_offset_rad.to_degrees());
                return fail(format!("azimuth_offset_deg[{i}]"), "between −360 and 360", found);
            }
            for (field, value) in [("height_m", ring.height_m), ("lateral_m", ring.lateral_m)] {
                if value.is_nan() || value.abs() > 10.0 {
                    return fail(format!("{field}[{i}]"), "between −10 and 10", value.to_string());
                }
            }
        }
        Ok(())
    }
}

impl TryFrom<SensorFile> for Sensor {
    type Error = SensorError;

    fn try_from(file: SensorFile) -> Result<Self, SensorError> {
        let count = file.elevation_deg.len();
        for (field, list) in [
            ("azimuth_offset_deg", &file.azimuth_offset_deg),
            ("height_m", &file.height_m),
            ("lateral_m", &file.lateral_m),
        ] {
            if !list.is_empty() && list.len() != count {
                return Err(SensorError::OutOfBounds {
                    name: file.name,
                    field: format!("length of {field}"),
                    expected: format!("{count}, as elevation_deg has"),
                    found: list.len().to_string(),
                });
            }
        }
        let at = |list: &[f64], i: usize| list.get(i).copied().unwrap_or(0.0);
        let rings = file.elevation_deg.iter().enumerate().map(|(i, elevation)| Ring {
            elevation_rad: elevation.to_radians(),
            azimuth_offset_rad: at(&file.azimuth_offset_deg, i).to_radians(),
            height_m: at(&file.height_m, i),
            lateral_m: at(&file.lateral_m, i),
        });
        Self::new(&file.name, rings.collect(), file.columns, (file.range_min_m, file.range_max_m), file.rotation_hz)
    }
}

impl From<Sensor> for SensorFile {
    fn from(sensor: Sensor) -> Self {
        let list = |value: fn(&Ring) -> f64| {
            let values: Vec<f64> = sensor.rings.iter().map(value).collect();
            if values.iter().all(|v| *v == 0.0) { Vec::new() } else { values }
        };
        // Tenths of a nanodegree: far below any sensor's resolution, and degrees stay readable (1.3, not 1.2999999999999998).
        let degrees = |radians: f64| (radians.to_degrees() * 1e10).round() / 1e10;
        Self {
            elevation_deg: sensor.rings.iter().map(|r| degrees(r.elevation_rad)).collect(),
            azimuth_offset_deg: list(|r| r.azimuth_offset_rad).into_iter().map(degrees).collect(),
            height_m: list(|r| r.height_m),
            lateral_m: list(|r| r.lateral_m),
            name: sensor.name,
            columns: sensor.columns,
            range_min_m: sensor.range_min_m,
            range_max_m: sensor.range_max_m,
            rotation_hz: sensor.rotation_hz,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_survives_its_own_toml() -> Result<(), SensorError> {
        let rings = (0..4)
            .map(|i| Ring {
                elevation_rad: (f64::from(i) * -1.3).to_radians(),
                azimuth_offset_rad: 0.01 * f64::from(i),
                height_m: 0.2,
                lateral_m: -0.026,
            })
            .collect();
        let sensor = Sensor::new("test", rings, 512, (0.5, 90.0), 10.0)?;
        let back = Sensor::from_toml(&sensor.to_toml())?;
        assert_eq!(back.columns(), 512);
        for (a, b) in sensor.rings().iter().zip(back.rings()) {
            assert!((a.elevation_rad - b.elevation_rad).abs() < 1e-11);
            assert!((a.azimuth_offset_rad - b.azimuth_offset_rad).abs() < 1e-11);
            assert_eq!((a.height_m, a.lateral_m), (b.height_m, b.lateral_m));
        }
        Ok(())
    }

    #[test]
    fn impossible_sensors_are_refused_by_name_of_the_field() {
        let toml = |columns: &str, elevation: &str| {
            let text = format!(
                "name = \"x\"\ncolumns = {columns}\nrange_min_m = 1.0\nrange_max_m = 100.0\nrotation_hz = 10.0\nelevation_deg = {elevation}"
            );
            Sensor::from_toml(&text).map_err(|e| e.to_string()).map(|s| s.pixels())
        };
        assert_eq!(toml("512", "[1.0, 0.0]"), Ok(1024));
        assert!(toml("0", "[1.0]").is_err_and(|e| e.contains("columns is 0, expected 8 to 16384")));
        assert!(toml("99999999", "[1.0]").is_err_and(|e| e.contains("columns")));
        assert!(toml("512", "[]").is_err_and(|e| e.contains("number of rings is 0")));
        assert!(toml("512", "[0.0, nan]").is_err_and(|e| e.contains("elevation_deg[1]")));
        assert!(toml("512", "[0.0]\nlateral_m = [0.0, 0.0]").is_err_and(|e| e.contains("length of lateral_m")));
        assert!(toml("512", "[0.0]\nwheels = 4").is_err_and(|e| e.contains("wheels")));
    }

    #[test]
    fn the_middle_column_looks_ahead_and_columns_turn_clockwise() -> Result<(), SensorError> {
        let sensor = Sensor::from_elevations_deg("flat", [0.0], 360, (0.0, 100.0), 10.0)?;
        let [x, y, _] = sensor.direction(0, 90);
        assert!(x > 0.0 && x < 0.01 && y > 0.99, "a quarter turn from behind looks left: {x} {y}");
        assert!(sensor.direction(0, 179)[0] > 0.999);
        Ok(())
    }
}
