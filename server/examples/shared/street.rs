//! A scan to send.

use lidar::{PointCloud, Sensor};

/// So many points of a street as the sensor sees it: ground below, walls around, a return on most rays.
pub(crate) fn street(sensor: &Sensor, points: usize) -> PointCloud {
    let mut cloud = PointCloud::new(1.0);
    for i in 0..points {
        let pixel = i * sensor.pixels() / points;
        let (ring, column) = (pixel / sensor.columns(), pixel % sensor.columns());
        let direction = sensor.direction(ring, column);
        let ground_m = if direction[2] < 0.0 { -1.73 / direction[2] } else { f64::INFINITY };
        let turn = column as f64 / sensor.columns() as f64;
        let wall_m = 10.0 + 8.0 * (turn * 20.0).sin();
        let range_m = ground_m.min(wall_m);
        cloud.x.push((direction[0] * range_m) as f32);
        cloud.y.push((direction[1] * range_m) as f32);
        cloud.z.push((direction[2] * range_m) as f32);
        cloud.intensity.push((i % 100) as f32 / 100.0);
    }
    cloud
}
