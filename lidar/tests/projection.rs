//! What goes through a projection comes back; what does not is counted.

use std::error::Error;

use lidar::cloud::{Column, Values};
use lidar::projection::{NO_PIXEL, ProjectionError};
use lidar::{Measured, PointCloud, Projection, Projector, Ring, RingSource, Sensor};

/// Whether a point, given by ring and step from straight ahead, is there.
type Keep<'a> = dyn Fn(u32, u32) -> bool + 'a;

type Outcome = Result<(), Box<dyn Error>>;

/// Sixteen rings in two blocks, every beam turned, raised and beside the axis as a real one's.
fn sensor() -> Result<Sensor, Box<dyn Error>> {
    let rings = (0..16)
        .map(|i| Ring {
            elevation_rad: (3.0 - 1.3 * f64::from(i) - if i > 7 { 2.0 } else { 0.0 }).to_radians(),
            azimuth_offset_rad: 0.0004 * f64::from(i),
            height_m: 0.2 - 0.002 * f64::from(i),
            lateral_m: if i % 2 == 0 { 0.026 } else { -0.026 },
        })
        .collect();
    Ok(Sensor::new("test", rings, 720, (0.5, 120.0), 10.0)?)
}

/// One point at the centre of every pixel, ring after ring, each counter-clockwise from straight ahead; every field filled.
fn cast(sensor: &Sensor) -> PointCloud {
    let mut cloud = PointCloud::new(255.0);
    for ring in 0..sensor.rings().len() {
        let mut points: Vec<[f64; 3]> = (0..sensor.columns())
            .map(|column| sensor.point_m(ring, column, 4.0 + ((ring * 31 + column * 17) % 701) as f64 * 0.09))
            .collect();
        let ahead = |[x, y, _]: &[f64; 3]| y.atan2(*x).rem_euclid(std::f64::consts::TAU);
        points.sort_by(|a, b| ahead(a).total_cmp(&ahead(b)));
        for [x, y, z] in points {
            cloud.x.push(x as f32);
            cloud.y.push(y as f32);
            cloud.z.push(z as f32);
            cloud.intensity.push((cloud.x.len() % 256) as f32);
        }
    }
    let n = cloud.len() as u32;
    cloud.label = Some((0..n).map(|i| 0x28 | (i << 16)).collect());
    cloud.time_s = Some((0..n).map(|i| f64::from(i) * 1e-6).collect());
    cloud.extra.push(Column { name: "echo".into(), values: Values::U16((0..n).map(|i| i as u16).collect()) });
    cloud
}

fn ring_field(sensor: &Sensor) -> Vec<u16> {
    (0..sensor.rings().len() as u16).flat_map(|ring| std::iter::repeat_n(ring, sensor.columns())).collect()
}

fn unchanged(projection: &mut Projection, cloud: &PointCloud) -> PointCloud {
    let image = projection.image.clone();
    let keep = vec![true; image.range_m().len()];
    let measured = Measured { range_m: image.range_m(), reflectance: image.reflectance(), keep: &keep };
    projection.reconstruct(cloud, measured)
}

/// A fixed permutation of `n` points.
fn shuffled(n: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..n as u32).collect();
    order.sort_by_key(|i| i.wrapping_mul(2_654_435_769).rotate_left(7));
    order
}

#[test]
fn a_scan_along_the_sensors_own_rays_comes_back_bit_for_bit() -> Outcome {
    let (sensor, cloud) = (sensor()?, cast(&sensor()?));
    let mut projection = Projector::new(&sensor).project(&cloud)?;
    assert_eq!(projection.report.ring_source, RingSource::Order);
    assert_eq!((projection.report.projected, projection.report.lost), (cloud.len(), 0));
    assert_eq!(projection.report.rings_seen, 16);
    let back = unchanged(&mut projection, &cloud);
    assert!((&back.x, &back.y, &back.z) == (&cloud.x, &cloud.y, &cloud.z));
    assert!((&back.label, &back.time_s, &back.extra) == (&cloud.label, &cloud.time_s, &cloud.extra));
    // Intensity goes through a reflectance: one division and one multiplication in single precision.
    assert!(back.intensity.iter().zip(&cloud.intensity).all(|(a, b)| (a - b).abs() < 1e-4));
    Ok(())
}

#[test]
fn image_and_sensor_alone_give_the_scan_back() -> Outcome {
    let (sensor, cloud) = (sensor()?, cast(&sensor()?));
    let projection = Projector::new(&sensor).project(&cloud)?;
    let back = projection.image.to_cloud(&sensor);
    back.check()?;
    assert_eq!(back.len(), cloud.len());
    let mut by_pixel: Vec<usize> = (0..cloud.len()).collect();
    by_pixel.sort_by_key(|i| projection.pixel_of_point[*i]);
    for (k, i) in by_pixel.into_iter().enumerate() {
        let error_m = (back.x[k] - cloud.x[i]).hypot(back.y[k] - cloud.y[i]).hypot(back.z[k] - cloud.z[i]);
        // Single precision at 70 m: 4 µm a coordinate.
        assert!(error_m < 2e-5, "point {i}: {error_m} m");
    }
    Ok(())
}

#[test]
fn a_dropped_ray_takes_its_point_and_a_measured_range_moves_it() -> Outcome {
    let (sensor, cloud) = (sensor()?, cast(&sensor()?));
    let mut projection = Projector::new(&sensor).project(&cloud)?;
    let farther: Vec<f32> = projection.image.range_m().iter().map(|r| r * 1.5).collect();
    let keep: Vec<bool> = (0..farther.len()).map(|i| i % 3 != 0).collect();
    let reflectance = vec![0.5; farther.len()];
    let back = projection.reconstruct(&cloud, Measured { range_m: &farther, reflectance: &reflectance, keep: &keep });
    let kept: Vec<u32> =
        (0..cloud.len() as u32).filter(|i| keep[projection.pixel_of_point[*i as usize] as usize]).collect();
    let expected = cloud.select(&kept);
    assert!((&back.label, &back.extra) == (&expected.label, &expected.extra));
    assert!(back.x.iter().zip(&expected.x).all(|(a, b)| (a - 1.5 * b).abs() <= 1e-5 * b.abs()));
    assert!(back.intensity.iter().all(|i| *i == 127.5));
    Ok(())
}

#[test]
fn every_point_is_counted_once() -> Outcome {
    let sensor = sensor()?;
    let mut cloud = cast(&sensor);
    cloud.ring = None;
    cloud.extra.clear();
    let odd = [
        [f32::NAN, 1.0, 1.0],
        [1.0, f32::INFINITY, 1.0],
        [1.0, 1.0, f32::NEG_INFINITY],
        [0.0, 0.0, 0.0],
        [-0.0, 0.0, 0.0],
        [0.2, 0.1, 0.0],
        [500.0, 0.0, 0.0],
        [3e38, 3e38, 0.0],
        [1.0, 1.0, 60.0],
        [0.0, 0.0, -9.0],
    ];
    for [x, y, z] in odd {
        cloud.x.push(x);
        cloud.y.push(y);
        cloud.z.push(z);
        cloud.intensity.push(1.0);
    }
    (cloud.label, cloud.time_s) = (None, None);
    let projection = Projector::new(&sensor).by_elevation().project(&cloud)?;
    let report = projection.report;
    assert_eq!((report.non_finite, report.zero_range, report.out_of_range, report.outside_view), (3, 2, 3, 2));
    assert_eq!(report.points_in, cloud.len());
    let named = report.non_finite + report.zero_range + report.out_of_range + report.outside_view;
    assert_eq!(report.projected + report.lost + named, report.points_in);
    let with_pixel = projection.pixel_of_point.iter().filter(|pixel| **pixel != NO_PIXEL).count();
    assert_eq!((with_pixel, projection.image.returns()), (report.projected, report.projected));
    Ok(())
}

#[test]
fn the_nearest_wins_and_the_loser_is_counted() -> Outcome {
    let sensor = Sensor::from_elevations_deg("flat", [0.0], 36, (0.5, 100.0), 10.0)?;
    let mut cloud = PointCloud::new(1.0);
    cloud.x = vec![9.0, 5.0, 7.0];
    cloud.y = vec![0.1; 3];
    cloud.z = vec![0.0; 3];
    cloud.intensity = vec![0.9, 0.5, 0.7];
    let projection = Projector::new(&sensor).project(&cloud)?;
    assert_eq!((projection.report.projected, projection.report.lost), (1, 2));
    assert_eq!(projection.pixel_of_point, [NO_PIXEL, 17, NO_PIXEL]);
    assert_eq!(projection.image.reflectance()[17], 0.5);
    Ok(())
}

#[test]
fn the_order_of_the_points_does_not_change_the_image() -> Outcome {
    let sensor = Sensor::from_elevations_deg("coarse", (0..16).map(|i| 3.0 - f64::from(i)), 90, (0.5, 120.0), 10.0)?;
    let mut cloud = cast(&self::sensor()?);
    // Points at one range in one pixel: the brighter wins, whichever comes first.
    for i in 0..cloud.len() / 2 {
        let twin = cloud.len() - 1 - i;
        if i % 5 == 0 {
            (cloud.x[twin], cloud.y[twin], cloud.z[twin]) = (cloud.x[i], cloud.y[i], cloud.z[i]);
        }
    }
    let straight = Projector::new(&sensor).by_elevation().project(&cloud)?;
    let permuted = Projector::new(&sensor).by_elevation().project(&cloud.select(&shuffled(cloud.len())))?;
    assert!(straight.report.lost > 1000, "the test is about lost points: {:?}", straight.report);
    assert!(straight.image == permuted.image);
    assert_eq!(straight.report, permuted.report);
    Ok(())
}

#[test]
fn a_ring_field_is_understood_in_three_numberings() -> Outcome {
    let sensor = sensor()?;
    let mut cloud = cast(&sensor);
    let top_down = ring_field(&sensor);
    let expected = Projector::new(&sensor).project(&cloud)?.image;
    let order = shuffled(cloud.len());
    let interleaved = |ring: u16| if ring < 8 { ring * 2 } else { (ring - 8) * 2 + 1 };
    for number in [|ring| ring, |ring| 15 - ring, interleaved] {
        cloud.ring = Some(top_down.iter().map(|ring| number(*ring)).collect());
        let projection = Projector::new(&sensor).project(&cloud.select(&order))?;
        assert_eq!(projection.report.ring_source, RingSource::Field);
        assert!(projection.image == expected);
    }
    Ok(())
}

#[test]
fn a_field_that_is_no_ring_is_not_taken_for_one() -> Outcome {
    let sensor = sensor()?;
    let mut cloud = cast(&sensor);
    cloud.ring = Some((0..cloud.len()).map(|i| (i % 3) as u16 * 7).collect());
    let report = Projector::new(&sensor).project(&cloud)?.report;
    assert_eq!((report.ring_source, report.lost), (RingSource::Order, 0));
    cloud.ring = Some(vec![999; cloud.len()]);
    assert_eq!(Projector::new(&sensor).project(&cloud)?.report.ring_source, RingSource::Order);
    Ok(())
}

#[test]
fn shuffled_points_find_their_rings_by_elevation() -> Outcome {
    let sensor = sensor()?;
    let cloud = cast(&sensor);
    let projection = Projector::new(&sensor).project(&cloud.select(&shuffled(cloud.len())))?;
    assert_eq!((projection.report.ring_source, projection.report.lost), (RingSource::Elevation, 0));
    assert!(projection.image == Projector::new(&sensor).project(&cloud)?.image);
    Ok(())
}

#[test]
fn rings_listed_from_behind_are_not_taken_for_kittis_order() -> Outcome {
    let sensor = sensor()?;
    let cloud = cast(&sensor);
    let half = sensor.columns() / 2;
    let from_behind: Vec<u32> = (0..cloud.len())
        .map(|i| (i - i % sensor.columns() + (i % sensor.columns() + half) % sensor.columns()) as u32)
        .collect();
    let projection = Projector::new(&sensor).project(&cloud.select(&from_behind))?;
    assert_eq!((projection.report.ring_source, projection.report.lost), (RingSource::Elevation, 0));
    Ok(())
}

#[test]
fn kittis_order_survives_gaps_and_jitter() -> Outcome {
    let sensor = sensor()?;
    let cloud = cast(&sensor);
    let expected = Projector::new(&sensor).project(&cloud)?;
    let (columns, quarter) = (sensor.columns() as u32, sensor.columns() as u32 / 4);
    let all = |_: u32, _: u32| true;
    let gap_before_the_wrap = |ring: u32, step: u32| ring != 5 || step < quarter * 3;
    let gap_of_half_a_turn = |ring: u32, step: u32| ring != 5 || !(10..10 + 2 * quarter + 40).contains(&step);
    let a_ring_is_missing = |ring: u32, _: u32| ring != 5;
    let cases: [(&str, &Keep<'_>); 4] = [
        ("all", &all),
        ("gap before the wrap", &gap_before_the_wrap),
        ("gap of half a turn", &gap_of_half_a_turn),
        ("missing ring", &a_ring_is_missing),
    ];
    for (name, keep) in cases {
        let mut kept: Vec<u32> = (0..cloud.len() as u32).filter(|i| keep(i / columns, i % columns)).collect();
        // The first and the last point of a ring change places, as motion compensation makes them do.
        let wrap = kept.iter().position(|i| *i == 9 * columns).ok_or("ring 9")?;
        kept.swap(wrap - 1, wrap - 2);
        let projection = Projector::new(&sensor).project(&cloud.select(&kept))?;
        assert_eq!(projection.report.ring_source, RingSource::Order, "{name}");
        assert_eq!(projection.report.lost, 0, "{name}");
        let right =
            kept.iter().zip(&projection.pixel_of_point).filter(|(i, p)| expected.pixel_of_point[**i as usize] == **p);
        assert_eq!(right.count(), kept.len(), "{name}");
    }
    Ok(())
}

#[test]
fn clouds_that_are_mostly_no_points_are_refused() -> Outcome {
    let sensor = sensor()?;
    let mut cloud = cast(&sensor);
    let n = cloud.len();
    cloud.x[..n / 2].fill(f32::NAN);
    assert!(Projector::new(&sensor).project(&cloud).is_ok());
    cloud.x[n / 2] = f32::NAN;
    let refused = Projector::new(&sensor).project(&cloud);
    assert_eq!(refused.err(), Some(ProjectionError::TooManyInvalid { invalid: n / 2 + 1, points: n }));
    Ok(())
}

#[test]
fn an_empty_cloud_is_an_empty_image() -> Outcome {
    let mut projection = Projector::new(&sensor()?).project(&PointCloud::new(1.0))?;
    assert_eq!((projection.report.points_in, projection.image.returns()), (0, 0));
    assert_eq!(unchanged(&mut projection, &PointCloud::new(1.0)).len(), 0);
    Ok(())
}

#[test]
fn memory_is_taken_once() -> Outcome {
    let (sensor, mut cloud) = (sensor()?, cast(&sensor()?));
    let (mut projector, mut projection, mut out) =
        (Projector::new(&sensor), Projection::default(), PointCloud::default());
    let mut places = Vec::new();
    for scan in 0..6 {
        // Fewer points each time: a smaller scan must not make the next larger one take memory again.
        let few: Vec<u32> = (0..cloud.len() as u32).filter(|i| scan % 2 == 0 || i % 3 != 0).collect();
        let cloud = if scan == 5 { cloud.clone() } else { cloud.select(&few) };
        projector.project_into(&cloud, &mut projection)?;
        let (range_m, reflectance) = (projection.image.range_m().to_vec(), projection.image.reflectance().to_vec());
        let keep = vec![true; range_m.len()];
        let measured = Measured { range_m: &range_m, reflectance: &reflectance, keep: &keep };
        projection.reconstruct_into(&cloud, measured, &mut out);
        places.push((
            projection.image.range_m().as_ptr(),
            projection.image.class().as_ptr(),
            projection.pixel_of_point.as_ptr(),
            out.x.as_ptr(),
            out.label.as_ref().map(Vec::as_ptr),
        ));
    }
    assert!(places.windows(2).all(|w| w[0] == w[1]), "{places:?}");
    cloud.x.clear();
    Ok(())
}

#[test]
fn counts_tell_rings_from_the_highest_down_whatever_a_field_or_the_elevation_says() -> Outcome {
    let sensor = sensor()?;
    let mut cloud = cast(&sensor);
    // A field in a numbering of its own, whose rings look elsewhere.
    cloud.ring = Some(ring_field(&sensor).iter().map(|ring| (ring + 5) % 16).collect());
    let mut projection = Projection::default();
    let mut counts = vec![sensor.columns() as u32; 16];
    let mut project =
        |counts: &[u32]| Projector::new(&sensor).project_counted_into(&cloud, Some(counts), &mut projection);
    project(&counts)?;
    counts[3] += 1;
    assert_eq!(project(&counts), Err(ProjectionError::OtherPoints { counted: 16 * 720 + 1, points: 16 * 720 }));
    assert_eq!(project(&counts[1..]), Err(ProjectionError::OtherRings { found: 15, rings: 16 }));
    counts[3] -= 1;
    project(&counts)?;
    assert_eq!((projection.report.ring_source, projection.report.lost), (RingSource::Counts, 0));
    for (i, pixel) in projection.pixel_of_point.iter().enumerate() {
        assert_eq!(*pixel as usize / sensor.columns(), i / sensor.columns());
    }
    Ok(())
}
