//! Points a second of projecting and reconstructing one scan: `cargo bench -p lidar --bench projection`.

use std::error::Error;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use lidar::{Measured, PointCloud, Projection, Projector, RingSource, Sensor};

fn main() {
    divan::main();
}

/// How the cloud tells its rings, and the grid it goes into.
#[derive(Clone, Copy, Debug)]
enum Case {
    /// KITTI order, 64 × 2048.
    Order,
    /// A ring field, points in the order of firing, 64 × 2048.
    Field,
    /// Neither: nearest elevation, points in the order of firing, 64 × 2048.
    Elevation,
    /// KITTI order, every laser beside the axis and turned: 64 × 4000, as an estimated HDL-64E.
    EstimatedGrid,
}

const CASES: [Case; 4] = [Case::Order, Case::Field, Case::Elevation, Case::EstimatedGrid];

#[divan::bench(args = CASES, sample_count = 200)]
fn project(bencher: Bencher<'_, '_>, case: Case) {
    let Ok((cloud, sensor)) = scan(case) else { return };
    let mut projector = Projector::new(&sensor);
    let mut projection = Projection::default();
    bencher
        .counter(ItemsCount::new(cloud.len()))
        .bench_local(|| black_box(projector.project_into(black_box(&cloud), &mut projection)).is_ok());
}

#[divan::bench(args = CASES, sample_count = 200)]
fn reconstruct(bencher: Bencher<'_, '_>, case: Case) {
    let Ok((cloud, sensor)) = scan(case) else { return };
    let Ok(mut projection) = Projector::new(&sensor).project(&cloud) else { return };
    let range_m = projection.image.range_m().to_vec();
    let reflectance = projection.image.reflectance().to_vec();
    // One ray in ten dropped, by no pattern.
    let keep: Vec<bool> = (0..range_m.len() as u32).map(|i| i.wrapping_mul(2_654_435_769) >> 24 > 25).collect();
    let mut out = PointCloud::default();
    bencher.counter(ItemsCount::new(cloud.len())).bench_local(|| {
        let measured = Measured { range_m: &range_m, reflectance: &reflectance, keep: &keep };
        projection.reconstruct_into(black_box(&cloud), measured, &mut out);
        black_box(out.len())
    });
}

/// About 120,000 points of a street with walls: a flat ground 1.7 m below, walls 8 to 30 m away.
fn scan(case: Case) -> Result<(PointCloud, Sensor), Box<dyn Error>> {
    const FIRINGS: usize = 1900;
    let mut sensor = Sensor::builtin("hdl64e")?;
    if matches!(case, Case::EstimatedGrid) {
        let mut rings = sensor.rings().to_vec();
        for (i, ring) in rings.iter_mut().enumerate() {
            ring.lateral_m = if i % 2 == 0 { -0.026 } else { 0.026 };
            ring.azimuth_offset_rad = 1e-5 * i as f64;
        }
        sensor = Sensor::new("turned", rings, 4000, sensor.range_limits_m(), 10.0)?;
    }
    let mut cloud = PointCloud::new(1.0);
    let mut ring_field = Vec::new();
    let mut put = |ring: usize, firing: usize| {
        let azimuth = (firing as f64 + 0.5) * std::f64::consts::TAU / FIRINGS as f64;
        let tangent = sensor.rings()[ring].elevation_rad.tan();
        let wall_m = 19.0 + 11.0 * (5.0 * azimuth).sin();
        let away_m = if tangent < 0.0 { wall_m.min(-1.7 / tangent) } else { wall_m };
        cloud.x.push((away_m * azimuth.cos()) as f32);
        cloud.y.push((away_m * azimuth.sin()) as f32);
        cloud.z.push((away_m * tangent) as f32);
        cloud.intensity.push(0.4);
        ring_field.push(ring as u16);
    };
    if matches!(case, Case::Order | Case::EstimatedGrid) {
        (0..64).for_each(|ring| (0..FIRINGS).for_each(|firing| put(ring, firing)));
    } else {
        (0..FIRINGS).for_each(|firing| (0..64).for_each(|ring| put(ring, firing)));
    }
    cloud.label = Some(vec![40; cloud.len()]);
    cloud.ring = matches!(case, Case::Field).then_some(ring_field);
    let report = Projector::new(&sensor).project(&cloud)?.report;
    let expected = match case {
        Case::Order | Case::EstimatedGrid => RingSource::Order,
        Case::Field => RingSource::Field,
        Case::Elevation => RingSource::Elevation,
    };
    assert_eq!(report.ring_source, expected, "{report:?}");
    Ok((cloud, sensor))
}
