//! Rays without a return in the projected scan, and the points of a sensor that reports one there all the same.

use super::{Measured, Projection};
use crate::cloud::PointCloud;
use crate::sensor::Sensor;

/// The rays of a sensor on which a projected cloud has no point.
#[derive(Clone, Copy, Debug)]
pub struct EmptyRays<'a> {
    /// The sensor that the cloud was projected to.
    pub sensor: &'a Sensor,
    /// The cloud.
    pub cloud: &'a PointCloud,
    /// Its projection.
    pub projection: &'a Projection,
}

impl EmptyRays<'_> {
    /// Appends the returns that are measured on these rays to the reconstructed cloud, ring after ring, and says how many there are.
    ///
    /// Each lies where the sensor's own ray of its pixel meets the measured range, with the measured reflectance as intensity, and with
    /// those of these fields that the cloud has: the ring in the cloud's numbering; the time of the cloud's points in the same column;
    /// label 0; return number 1. Extra columns are 0, or NaN where they are floats.
    ///
    /// # Panics
    /// If sensor, cloud, projection and `measured` do not belong together, or `out` has not the cloud's columns.
    pub fn append_measured(&self, measured: Measured<'_>, out: &mut PointCloud) -> usize {
        let (columns, before) = (self.sensor.columns(), out.len());
        let column_time_s = out.time_s.is_some().then(|| self.column_time_s());
        for (pixel, simulated_m) in self.projection.image.range_m().iter().enumerate() {
            let range_m = measured.range_m[pixel];
            if *simulated_m > 0.0 || !measured.keep[pixel] || range_m.is_nan() || range_m <= 0.0 {
                continue;
            }
            let (row, column) = (pixel / columns, pixel % columns);
            let [x, y, z] = self.sensor.point_m(row, column, f64::from(range_m));
            out.x.push(x as f32);
            out.y.push(y as f32);
            out.z.push(z as f32);
            out.intensity.push(measured.reflectance[pixel] * out.full_scale);
            if let Some(ring) = &mut out.ring {
                ring.push(self.projection.ring_of_row[row]);
            }
            if let (Some(time_s), Some(column_time_s)) = (&mut out.time_s, &column_time_s) {
                time_s.push(column_time_s[column]);
            }
        }
        out.fill_up();
        out.len() - before
    }

    /// Time of each column: that of its first point, of the nearest column that has one, or, where none has, since the sweep's start.
    fn column_time_s(&self) -> Vec<f64> {
        let columns = self.sensor.columns();
        let mut known: Vec<Option<f64>> = vec![None; columns];
        for (pixel, time_s) in self.projection.pixel_of_point.iter().zip(self.cloud.time_s.iter().flatten()) {
            if *pixel != super::NO_PIXEL {
                known[*pixel as usize % columns].get_or_insert(*time_s);
            }
        }
        let nearest = |column: usize| {
            (0..=columns / 2)
                .find_map(|away| known[(column + columns - away) % columns].or(known[(column + away) % columns]))
        };
        let period_s = 1.0 / (f64::from(self.sensor.rotation_hz()) * columns as f64);
        (0..columns).map(|column| nearest(column).unwrap_or(column as f64 * period_s)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{Column, Values};
    use crate::projection::Projector;

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    /// Two rings of twelve columns; the cloud has one point in each column of the upper ring but the first and the last.
    fn upper_ring() -> Result<(Sensor, PointCloud), Box<dyn std::error::Error>> {
        let sensor = Sensor::from_elevations_deg("two", [5.0, -5.0], 12, (0.5, 100.0), 10.0)?;
        let mut cloud = PointCloud::new(255.0);
        for column in 1..11 {
            let [x, y, z] = sensor.point_m(0, column, 10.0);
            cloud.x.push(x as f32);
            cloud.y.push(y as f32);
            cloud.z.push(z as f32);
        }
        cloud.intensity = vec![1.0; 10];
        // Numbered from below, as some drivers do.
        cloud.ring = Some(vec![1; 10]);
        cloud.label = Some(vec![40; 10]);
        cloud.return_number = Some(vec![2; 10]);
        cloud.time_s = Some((1..11).map(|column| 5.0 + f64::from(column)).collect());
        let extra = |name: &str, values| Column { name: name.into(), values };
        cloud.extra = vec![extra("echo", Values::I16(vec![7; 10])), extra("width", Values::F32(vec![7.0; 10]))];
        Ok((sensor, cloud))
    }

    #[test]
    fn a_new_return_has_what_its_ray_knows_and_nothing_else() -> Outcome {
        let (sensor, cloud) = upper_ring()?;
        let mut projection = Projector::new(&sensor).project(&cloud)?;
        let range_m: Vec<f32> = projection.image.range_m().iter().map(|r| if *r > 0.0 { *r } else { 20.0 }).collect();
        let mut keep = vec![true; 24];
        keep[12 + 5] = false;
        let measured = Measured { range_m: &range_m, reflectance: &[0.5; 24], keep: &keep };
        let mut out = projection.reconstruct(&cloud, measured);
        let empty = EmptyRays { sensor: &sensor, cloud: &cloud, projection: &projection };
        // Columns 0 and 11 of the upper ring, all but one of the lower.
        assert_eq!(empty.append_measured(measured, &mut out), 2 + 11);
        out.check()?;
        assert!(out.select(&(0..10).collect::<Vec<_>>()).label == cloud.label, "the others come first");
        let new = out.select(&(10..23).collect::<Vec<_>>());
        assert_eq!(new.ring, Some([vec![1; 2], vec![0; 11]].concat()));
        let times = [6.0, 15.0, 6.0, 6.0, 7.0, 8.0, 9.0, 11.0, 12.0, 13.0, 14.0, 15.0, 15.0];
        assert_eq!(new.time_s, Some(times.to_vec()), "of the column, or of the nearest that has one");
        assert_eq!((new.label, new.return_number), (Some(vec![0; 13]), Some(vec![1; 13])));
        assert!(new.intensity.iter().all(|i| *i == 127.5));
        assert_eq!(new.extra[0].values, Values::I16(vec![0; 13]));
        assert!(new.extra[1].values.to_f64().iter().all(|v| v.is_nan()), "nobody measured it");
        let [x, y, z] = sensor.point_m(1, 11, 20.0);
        assert_eq!([new.x[12], new.y[12], new.z[12]], [x as f32, y as f32, z as f32]);
        Ok(())
    }

    #[test]
    fn only_positive_ranges_are_returns_and_an_empty_sweep_keeps_the_sensors_time() -> Outcome {
        let sensor = upper_ring()?.0;
        let cloud = PointCloud { time_s: Some(vec![]), ..PointCloud::new(1.0) };
        let mut projection = Projector::new(&sensor).project(&cloud)?;
        let mut range_m = vec![0.0; 24];
        (range_m[1], range_m[2], range_m[18]) = (f32::NAN, -3.0, 9.0);
        let measured = Measured { range_m: &range_m, reflectance: &[0.5; 24], keep: &[true; 24] };
        let mut out = projection.reconstruct(&cloud, measured);
        let empty = EmptyRays { sensor: &sensor, cloud: &cloud, projection: &projection };
        assert_eq!(empty.append_measured(measured, &mut out), 1);
        // Column 6 of 12, ten turns a second.
        assert!((out.time_s.ok_or("time")?[0] - 0.05).abs() < 1e-12);
        Ok(())
    }
}
