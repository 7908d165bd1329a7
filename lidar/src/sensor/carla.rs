//! CARLA's ray-cast lidar, from the attributes of its blueprint.

use super::{Sensor, SensorError};

impl Sensor {
    /// The sensor that CARLA simulates for these blueprint attributes (`sensor.lidar.ray_cast` and its semantic sibling), given as pairs
    /// of name and value; attributes that are left out have CARLA's defaults, those that are no geometry are passed over.
    ///
    /// | attribute | default | meaning |
    /// |---|---|---|
    /// | `channels` | 32 | rings, evenly from `upper_fov` down to `lower_fov` |
    /// | `upper_fov`, `lower_fov` | 10, −30 | degrees |
    /// | `range` | 10 | metres |
    /// | `points_per_second` | 56000 | columns = `points_per_second` / (`channels` · `rotation_frequency`), rounded |
    /// | `rotation_frequency` | 10 | turns a second |
    /// | `horizontal_fov` | 360 | degrees; no other is a whole turn |
    ///
    /// A scan is a whole turn only if the simulation steps by 1 / `rotation_frequency`. Mind that CARLA's y points to the right:
    /// [`PointCloud::mirror_y`](crate::PointCloud::mirror_y).
    pub fn from_carla_blueprint<'a>(
        attributes: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, SensorError> {
        const NAME: &str = "CARLA";
        let fail = |field: &str, expected: &str, found: String| SensorError::OutOfBounds {
            name: NAME.into(),
            field: field.into(),
            expected: expected.into(),
            found,
        };
        let known = [
            ("channels", 32.0),
            ("upper_fov", 10.0),
            ("lower_fov", -30.0),
            ("range", 10.0),
            ("points_per_second", 56_000.0),
            ("rotation_frequency", 10.0),
            ("horizontal_fov", 360.0),
        ];
        let mut values = known.map(|(_, default)| default);
        for (name, value) in attributes {
            if let Some(i) = known.iter().position(|(known, _)| *known == name) {
                let number = value.trim().parse::<f64>().ok().filter(|number| number.is_finite());
                values[i] = number.ok_or_else(|| fail(name, "a number", format!("{value:?}")))?;
            }
        }
        let [channels, upper_deg, lower_deg, range_m, points_per_s, rotation_hz, horizontal_deg] = values;
        if horizontal_deg != 360.0 {
            return Err(fail("horizontal_fov", "360", horizontal_deg.to_string()));
        }
        if !(1.0..=1024.0).contains(&channels) || channels.fract() != 0.0 {
            return Err(fail("channels", "a whole number from 1 to 1024", channels.to_string()));
        }
        if upper_deg < lower_deg {
            return Err(fail("upper_fov", &format!("at least lower_fov, {lower_deg}"), upper_deg.to_string()));
        }
        let step_deg = if channels > 1.0 { (upper_deg - lower_deg) / (channels - 1.0) } else { 0.0 };
        let elevations_deg = (0..channels as usize).map(|i| upper_deg - step_deg * i as f64);
        let columns = (points_per_s / (channels * rotation_hz)).round();
        Self::from_elevations_deg(NAME, elevations_deg, columns as usize, (0.0, range_m as f32), rotation_hz as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blueprint_gives_carlas_grid() -> Result<(), SensorError> {
        let attributes = [
            ("channels", "64"),
            ("lower_fov", "-45.0"),
            ("range", "70"),
            ("points_per_second", "1280000"),
            ("rotation_frequency", "20"),
            ("role_name", "front"),
        ];
        let sensor = Sensor::from_carla_blueprint(attributes)?;
        assert_eq!((sensor.rings().len(), sensor.columns(), sensor.range_limits_m()), (64, 1000, (0.0, 70.0)));
        assert!((sensor.rings()[0].elevation_rad.to_degrees() - 10.0).abs() < 1e-12);
        assert!((sensor.rings()[63].elevation_rad.to_degrees() + 45.0).abs() < 1e-12);
        Ok(())
    }

    #[test]
    fn what_is_left_out_is_carlas_default() -> Result<(), SensorError> {
        let sensor = Sensor::from_carla_blueprint([])?;
        assert_eq!((sensor.rings().len(), sensor.columns()), (32, 175));
        Ok(())
    }

    #[test]
    fn impossible_attributes_are_refused_by_name() {
        let error = |name, value| match Sensor::from_carla_blueprint([(name, value)]) {
            Ok(_) => String::new(),
            Err(error) => error.to_string(),
        };
        assert!(error("horizontal_fov", "180").contains("horizontal_fov is 180, expected 360"));
        assert!(error("channels", "0").contains("channels"));
        assert!(error("channels", "1e12").contains("channels"));
        assert!(error("range", "far").contains("range is \"far\""));
        assert!(error("rotation_frequency", "0").contains("columns"));
        assert!(error("rotation_frequency", "-1").contains("columns"));
        assert!(error("points_per_second", "inf").contains("points_per_second"));
        assert!(error("upper_fov", "-40").contains("upper_fov"));
    }
}
