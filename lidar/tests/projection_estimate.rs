//! A sensor is found again from the scans that it takes.

use std::error::Error;
use std::f64::consts::TAU;

use lidar::projection::loss::{losses, usual_candidates};
use lidar::sensor::estimate::{Columns, EstimateError, EstimateOptions};
use lidar::{PointCloud, Ring, RingSource, Sensor};

type Outcome = Result<(), Box<dyn Error>>;

const COLUMNS: usize = 3600;

/// Twenty-four rings as an HDL-64E's: uneven elevations, 26 mm beside the axis to either side, 0.2 m up.
fn sensor() -> Result<Sensor, Box<dyn Error>> {
    let rings = (0..24)
        .map(|i| Ring {
            elevation_rad: (2.0 - 0.7 * f64::from(i) - if i > 11 { 0.9 } else { 0.0 }).to_radians(),
            azimuth_offset_rad: (f64::from(i) * 0.37).sin() * 0.45 * TAU / COLUMNS as f64,
            height_m: 0.21 - 0.001 * f64::from(i),
            lateral_m: if i % 2 == 0 { 0.026 } else { -0.026 },
        })
        .collect();
    Ok(Sensor::new("truth", rings, COLUMNS, (0.9, 120.0), 10.0)?)
}

/// Ticks at which a sensor fires that skips every second one or so: by how many columns each firing follows the one before.
fn ticks() -> Vec<usize> {
    let mut ticks = Vec::new();
    let (mut tick, mut i) = (0, 0u32);
    while tick < COLUMNS {
        ticks.push(tick);
        i += 1;
        tick += if i.wrapping_mul(2_654_435_769) >> 30 == 0 { 1 } else { 2 };
    }
    ticks
}

/// A street as `sensor` sees it when ring r fires `shift(r)` columns late, in KITTI's order, stored in millimetres.
fn scan(sensor: &Sensor, shift: impl Fn(usize) -> usize) -> PointCloud {
    let mut cloud = PointCloud::new(1.0);
    for (ring, beam) in sensor.rings().iter().enumerate() {
        let mut points: Vec<[f64; 3]> = Vec::new();
        for tick in ticks() {
            let column = (tick + shift(ring)) % sensor.columns();
            // A shadow without returns, walls with doorways, and a ground that is not quite level.
            let azimuth = sensor.azimuth_rad(column);
            if (2.0..2.2).contains(&azimuth) {
                continue;
            }
            let doorway = if column % 97 < 30 { 6.0 } else { 0.0 };
            let wall_m = 16.0 + 9.0 * (3.0 * azimuth).sin() + 2.0 * (17.0 * azimuth).sin() + doorway;
            let ground_m = (1.7 + 0.06 * (5.0 * azimuth).sin()) / (-beam.elevation_rad.sin()).max(1e-3);
            points.push(sensor.point_m(ring, column, wall_m.min(ground_m)));
        }
        let ahead = |[x, y, _]: &[f64; 3]| y.atan2(*x).rem_euclid(TAU);
        points.sort_by(|a, b| ahead(a).total_cmp(&ahead(b)));
        for point in points {
            let [x, y, z] = point.map(|metres| ((metres * 1000.0).round() / 1000.0) as f32);
            cloud.x.push(x);
            cloud.y.push(y);
            cloud.z.push(z);
            cloud.intensity.push(0.5);
        }
    }
    cloud
}

#[test]
fn a_sensor_is_found_again_from_one_scan() -> Outcome {
    let truth = sensor()?;
    let cloud = scan(&truth, |_| 0);
    let estimate = Sensor::estimate(std::slice::from_ref(&cloud), &EstimateOptions::default())?;
    assert_eq!(estimate.ring_source, RingSource::Order);
    assert_eq!((estimate.sensor.columns(), estimate.sensor.rings().len()), (COLUMNS, 24));
    assert!(
        matches!(estimate.columns, Columns::Encoder { concentration } if concentration > 0.9),
        "{:?}",
        estimate.columns
    );
    assert_eq!((estimate.points, estimate.lost), (cloud.len(), 0));
    for (i, (found, ring)) in estimate.sensor.rings().iter().zip(truth.rings()).enumerate() {
        // A millimetre's rounding at ranges of 5 to 30 m, averaged over a thousand points; where a ring sees little but the ground
        // in one distance, its slope and its height share a millimetre as they please.
        assert!((found.elevation_rad - ring.elevation_rad).abs() < 1e-4, "elevation of ring {i}: {found:?}");
        assert!((found.azimuth_offset_rad - ring.azimuth_offset_rad).abs() < 2e-5, "offset of ring {i}: {found:?}");
        assert!((found.height_m - ring.height_m).abs() < 1e-3, "height of ring {i}: {found:?}");
        assert!((found.lateral_m - ring.lateral_m).abs() < 5e-4, "lateral distance of ring {i}: {found:?}");
    }
    Ok(())
}

#[test]
fn an_estimated_grid_loses_no_point_and_gives_each_back_within_a_millimetre() -> Outcome {
    let truth = sensor()?;
    let clouds = [scan(&truth, |_| 0), scan(&truth, |ring| 100 + ring)];
    let estimate = Sensor::estimate(&clouds, &EstimateOptions::default())?;
    let table = losses(&clouds, &usual_candidates(&truth, &estimate.sensor)?)?;
    assert_eq!(table.len(), 5);
    let [coarse, .., grid] = table.as_slice() else { return Err("rows".into()) };
    assert!(coarse.lost > coarse.points / 5, "1024 columns are too few for 2000 firings: {coarse:?}");
    assert_eq!((grid.points, grid.lost, grid.outside), (clouds[0].len() + clouds[1].len(), 0, 0));
    assert!(grid.max_error_m < 1e-3, "{grid:?}");
    Ok(())
}

#[test]
fn rings_that_fire_out_of_step_tell_it_by_the_ticks_they_skip() -> Outcome {
    let truth = sensor()?;
    let shift = |ring: usize| (ring * 53) % 200;
    let estimate = Sensor::estimate(&[scan(&truth, shift)], &EstimateOptions::default())?;
    let offsets: Vec<f64> =
        estimate.rings.iter().map(|fit| fit.firing_offset_rad.ok_or("unknown")).collect::<Result<_, _>>()?;
    let column_rad = TAU / COLUMNS as f64;
    for ring in 1..24 {
        // A later column is farther to the right.
        let columns = shift(0) as f64 - shift(ring) as f64;
        let expected =
            columns * column_rad + truth.rings()[ring].azimuth_offset_rad - truth.rings()[0].azimuth_offset_rad;
        let found = offsets[ring] - offsets[0];
        assert!((found - expected).abs() < 1e-4, "ring {ring}: {found} instead of {expected}");
    }
    Ok(())
}

#[test]
fn a_ring_field_in_any_numbering_gives_the_same_sensor() -> Outcome {
    let truth = sensor()?;
    let mut cloud = scan(&truth, |_| 0);
    let by_order = Sensor::estimate(std::slice::from_ref(&cloud), &EstimateOptions::default())?;
    let mut ring = Vec::new();
    for i in 0..24 {
        ring.extend(std::iter::repeat_n((i * 7 % 24) as u16, by_order.rings[i].points));
    }
    cloud.ring = Some(ring);
    let by_field = Sensor::estimate(&[cloud], &EstimateOptions::default())?;
    assert_eq!((by_field.ring_source, by_field.lost), (RingSource::Field, 0));
    assert_eq!(by_field.sensor, by_order.sensor);
    Ok(())
}

#[test]
fn beams_from_one_point_are_told_apart_without_field_or_order() -> Outcome {
    let truth = Sensor::from_carla_blueprint([("range", "100"), ("points_per_second", "320000")])?;
    let mut cloud = PointCloud::new(1.0);
    for column in 0..truth.columns() {
        for ring in (0..truth.rings().len()).rev() {
            let [x, y, z] = truth.point_m(ring, column, 8.0 + ((ring + column) % 40) as f64);
            cloud.x.push(x as f32);
            cloud.y.push(y as f32);
            cloud.z.push(z as f32);
            cloud.intensity.push(0.0);
        }
    }
    let estimate = Sensor::estimate(std::slice::from_ref(&cloud), &EstimateOptions::default())?;
    assert_eq!((estimate.ring_source, estimate.lost), (RingSource::Elevation, 0));
    assert_eq!((estimate.sensor.rings().len(), estimate.sensor.columns()), (32, 1000));
    let worst =
        estimate.sensor.rings().iter().zip(truth.rings()).map(|(a, b)| (a.elevation_rad - b.elevation_rad).abs());
    assert!(worst.fold(0.0, f64::max) < 1e-5);
    Ok(())
}

#[test]
fn columns_of_a_moving_sensors_scan_are_not_made_up() -> Outcome {
    let mut cloud = scan(&sensor()?, |_| 0);
    let n = cloud.len() as f32;
    for i in 0..cloud.len() {
        // The points of a turn moved to where they were seen at its end: up to a metre, more for some.
        let part = (i * 7919 % cloud.len()) as f32 / n;
        cloud.x[i] += part;
        cloud.y[i] += 0.3 * part;
    }
    let estimate = Sensor::estimate(&[cloud], &EstimateOptions::default())?;
    assert_eq!(estimate.columns, Columns::Unknown);
    assert!(estimate.sensor.rings().iter().all(|ring| ring.azimuth_offset_rad == 0.0 && ring.lateral_m == 0.0));
    assert!(estimate.rings.iter().all(|fit| fit.azimuth_residual_m.is_none()));
    Ok(())
}

#[test]
fn points_without_rings_are_refused() {
    let mut cloud = PointCloud::new(1.0);
    for i in 0..20_000u32 {
        let number = |k: u32| (i.wrapping_mul(k) >> 8) as f32 / 16_777_216.0 - 0.5;
        cloud.x.push(60.0 * number(2_654_435_769));
        cloud.y.push(60.0 * number(2_246_822_519));
        cloud.z.push(20.0 * number(3_266_489_917));
        cloud.intensity.push(0.0);
    }
    let options = EstimateOptions::default();
    assert!(matches!(Sensor::estimate(&[cloud], &options), Err(EstimateError::NoRings)));
    assert!(matches!(Sensor::estimate(&[], &options), Err(EstimateError::TooFewPoints { points: 0, clouds: 0 })));
    let mut nowhere = PointCloud::new(1.0);
    for column in [&mut nowhere.x, &mut nowhere.y, &mut nowhere.z, &mut nowhere.intensity] {
        column.resize(1000, f32::NAN);
    }
    nowhere.ring = Some(vec![0; 1000]);
    assert!(matches!(Sensor::estimate(&[nowhere], &options), Err(EstimateError::TooFewPoints { .. })));
}
