//! The returns of a scan as points.

use lidar::{RangeImage, Sensor};

/// A point in the sensor's frame, in metres.
pub type Point = [f32; 3];

/// Every pixel's point, `[ring, column]`: where the sensor's own ray of that pixel meets the measured range; the origin where there is no
/// return.
///
/// # Panics
/// If the image has not the sensor's size.
pub fn every_pixel(image: &RangeImage, sensor: &Sensor) -> Vec<Point> {
    assert_eq!(
        (image.rings(), image.columns()),
        (sensor.rings().len(), sensor.columns()),
        "an image of the sensor's size"
    );
    let point = |(i, range_m): (usize, &f32)| {
        if *range_m > 0.0 {
            let (ring, column) = (i / image.columns(), i % image.columns());
            sensor.point_m(ring, column, f64::from(*range_m)).map(|x| x as f32)
        } else {
            [0.0; 3]
        }
    };
    image.range_m().iter().enumerate().map(point).collect()
}

/// The points of the returns alone.
///
/// # Panics
/// If the image has not the sensor's size.
pub fn returns(image: &RangeImage, sensor: &Sensor) -> Vec<Point> {
    let points = every_pixel(image, sensor).into_iter().zip(image.range_m());
    points.filter(|(_, range_m)| **range_m > 0.0).map(|(point, _)| point).collect()
}

/// Squared distance, in the square of the points' unit.
pub fn squared(a: &Point, b: &Point) -> f32 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)
}
