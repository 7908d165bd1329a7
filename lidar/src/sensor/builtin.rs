//! The sensors that ship with the library.

use super::{Sensor, SensorError};

/// Names that [`Sensor::builtin`] knows.
pub const BUILTIN: [&str; 5] = ["hdl64e", "hdl64e-uniform", "hdl32e", "vlp16", "vlp32c"];

impl Sensor {
    /// A sensor by its name:
    ///
    /// | name | rings | elevation | columns |
    /// |---|---|---|---|
    /// | `hdl64e` | 64 | two blocks: 32 from +1.9° down by 0.335°, 32 from −8.9° down by 0.515° (HDL-64E S2 and S3 calibrations) | 2048 |
    /// | `hdl64e-uniform` | 64 | +3 to −25°, evenly: the grid of SemanticKITTI's and RangeNet++'s projections | 2048 |
    /// | `hdl32e` | 32 | +10.67 to −30.67° by 4/3° | 1024 |
    /// | `vlp16` | 16 | +15 to −15° by 2° | 1800 |
    /// | `vlp32c` | 32 | the manual's uneven table, densest around the horizon | 1800 |
    pub fn builtin(name: &str) -> Result<Self, SensorError> {
        let spread = |top: f64, bottom: f64, n: usize| -> Vec<f64> {
            (0..n).map(|i| top + (bottom - top) * i as f64 / (n - 1) as f64).collect()
        };
        match name {
            "hdl64e" => {
                let upper = (0..32).map(|i| 1.9 - 0.335 * f64::from(i));
                let lower = (0..32).map(|i| -8.9 - 0.515 * f64::from(i));
                Self::from_elevations_deg("Velodyne HDL-64E", upper.chain(lower), 2048, (0.9, 120.0), 10.0)
            }
            "hdl64e-uniform" => Self::from_elevations_deg(
                "Velodyne HDL-64E, uniform elevations",
                spread(3.0, -25.0, 64),
                2048,
                (0.9, 120.0),
                10.0,
            ),
            "hdl32e" => Self::from_elevations_deg(
                "Velodyne HDL-32E",
                spread(32.0 / 3.0, -92.0 / 3.0, 32),
                1024,
                (1.0, 100.0),
                20.0,
            ),
            "vlp16" => Self::from_elevations_deg("Velodyne VLP-16", spread(15.0, -15.0, 16), 1800, (0.5, 100.0), 10.0),
            "vlp32c" => Self::from_elevations_deg("Velodyne VLP-32C", VLP32C_ELEVATION_DEG, 1800, (0.5, 200.0), 10.0),
            _ => Err(SensorError::Unknown { name: name.into(), known: BUILTIN.join(", ") }),
        }
    }
}

/// VLP-32C User Manual (63-9325), table of the lasers' vertical angles, top first.
const VLP32C_ELEVATION_DEG: [f64; 32] = [
    15.0, 10.333, 7.0, 4.667, 3.333, 2.333, 1.667, 1.333, 1.0, 0.667, 0.333, 0.0, -0.333, -0.667, -1.0, -1.333, -1.667,
    -2.0, -2.333, -2.667, -3.0, -3.333, -3.667, -4.0, -4.667, -5.333, -6.148, -7.254, -8.843, -11.31, -15.639, -25.0,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_builtin_sensor_is_valid_and_looks_down_ring_by_ring() -> Result<(), SensorError> {
        for name in BUILTIN {
            let sensor = Sensor::builtin(name)?;
            assert!(sensor.rings().windows(2).all(|w| w[0].elevation_rad > w[1].elevation_rad), "{name}");
        }
        assert!(Sensor::builtin("hdl65").is_err_and(|e| e.to_string().contains("hdl64e-uniform")));
        Ok(())
    }
}
