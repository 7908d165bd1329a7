//! Scans in other units, of other sensors, or without numbers.

use super::*;

#[test]
fn numbers_that_are_none_are_counted() {
    let mut halves = sound();
    halves.measured[1].z[17] = f32::NAN;
    halves.measured[1].z[20] = f32::INFINITY;
    refused(halves.read(), Some(DefectKind::NotFinite), &["measured/000001.ply: z: 2 of", "point 17"]);
    let mut halves = sound();
    halves.simulated[0].intensity[3] = f32::NAN;
    refused(halves.read(), Some(DefectKind::NotFinite), &["sim/000000.ply: intensity: 1 of", "point 3"]);
}

#[test]
fn rays_that_all_dropped_are_refused_on_either_side() {
    let mut halves = sound();
    drop_points(&mut halves.measured[5], |_| false);
    refused(halves.read(), Some(DefectKind::NoReturns), &["measured/000005.ply", "every ray was dropped"]);
    let mut halves = sound();
    drop_points(&mut halves.simulated[5], |_| false);
    refused(halves.read(), Some(DefectKind::NoReturns), &["sim/000005.ply", "every ray was dropped"]);
}

#[test]
fn rings_past_the_last_are_refused() {
    let mut halves = sound();
    halves.measured[0].ring.as_mut().unwrap()[5] = 16;
    refused(halves.read(), Some(DefectKind::RingOutOfRange), &["measured/000000.ply: ring", "point 5", "0 to 15"]);
    let from_one = sound().each_measured(|c| c.ring.as_mut().unwrap().iter_mut().for_each(|r| *r += 1));
    refused(from_one.read(), Some(DefectKind::RingOutOfRange), &["ring: 1 to 16", "subtract 1"]);
}

#[test]
fn scans_with_another_number_of_rings_are_refused() {
    let many = cast_by(&sensor_of((0..32).map(|r| 2.0 - 0.8 * f64::from(r)).collect(), 256));
    let halves = Halves { measured: many, ..sound() };
    refused(halves.read(), Some(DefectKind::RingCount), &["measured/000000.ply: ring: 0 to 31", "has 16 rings"]);
    let few = cast_by(&sensor_of((0..8).map(|r| 15.0 - 4.0 * f64::from(r)).collect(), 256));
    let halves = Halves { measured: few, ..sound() };
    refused(halves.read(), Some(DefectKind::RingCount), &["measured/000000.ply: ring: 8 rings have points", "16 rays"]);
}

#[test]
fn scans_with_another_number_of_columns_are_refused() {
    for (columns, text) in [(512, "512 columns a turn"), (128, "128 columns a turn"), (300, "300 columns a turn")] {
        let halves = Halves { measured: cast_by(&sensor_of(elevations_deg(), columns)), ..sound() };
        let words = ["measured/000000.ply: x, y", text, "columns = 256"];
        refused(halves.read(), Some(DefectKind::ColumnCount), &words);
    }
}

#[test]
fn scans_of_other_rays_are_refused() {
    let other = sensor_of(elevations_deg().iter().map(|e| e * 0.5 + 4.0).collect(), 256);
    let halves = Halves { measured: cast_by(&other), ..sound() };
    refused(
        halves.read(),
        Some(DefectKind::OffRays),
        &["measured/000000.ply: ring", "% of the points", "Another sensor?"],
    );
    // By elevation alone, rings between those of the sensor's file are told by where they are.
    let between = sensor_of(elevations_deg().iter().map(|e| e - 0.7).collect(), 256);
    let mut halves = Halves { measured: cast_by(&between), ..sound() };
    halves.measured.iter_mut().for_each(|cloud| cloud.ring = None);
    halves.measured.iter_mut().for_each(shuffle);
    refused(halves.read(), Some(DefectKind::OffRays), &["measured/000000.ply: x, y, z", "`ring` field"]);
}

#[test]
fn elevations_in_radians_are_told() {
    let dir = sound().write();
    let path = dir.path().join("sensor.toml");
    let radians = elevations_deg().into_iter().map(f64::to_radians).collect();
    fs::write(&path, sensor_of(radians, 256).to_toml()).unwrap();
    refused(
        PairedSet::read(dir.path()),
        Some(DefectKind::AngleUnit),
        &["sensor.toml: elevation_deg", "radians", "180/π"],
    );
}

#[test]
fn intensities_of_another_scale_are_told() {
    let bytes = sound().each_measured(|c| c.intensity.iter_mut().for_each(|i| *i *= 255.0));
    refused(bytes.read(), Some(DefectKind::IntensityUnit), &["measured/000000.ply: intensity", "from 0 to 1", "0–255"]);
    let percent = sound().each(|c| c.intensity.iter_mut().for_each(|i| *i *= 100.0));
    refused(percent.read(), Some(DefectKind::IntensityUnit), &["sim/000000.ply: intensity", "divide by 100"]);
    let decibels = sound().each_measured(|c| c.intensity.iter_mut().for_each(|i| *i = 10.0 * i.max(0.01).log10()));
    refused(decibels.read(), Some(DefectKind::IntensityUnit), &["measured/000000.ply: intensity", "decibels"]);
}

#[test]
fn ranges_in_other_units_are_told() {
    for (factor, unit) in
        [(1000.0, "millimetres"), (100.0, "centimetres"), (3.281, "feet"), (10.0, "decimetres"), (0.001, "kilometres")]
    {
        let halves = sound().each_measured(|cloud| scale(cloud, factor));
        refused(halves.read(), Some(DefectKind::RangeUnit), &["measured/000000.ply: x, y, z", unit]);
    }
    let simulated = Halves { simulated: sound().each_measured(|c| scale(c, 1000.0)).measured, ..sound() };
    refused(simulated.read(), Some(DefectKind::RangeUnit), &["sim/000000.ply: x, y, z", "millimetres"]);
    let both = sound().each(|cloud| scale(cloud, 1000.0));
    refused(both.read(), Some(DefectKind::RangeUnit), &["sim/000000.ply: x, y, z", "millimetres", "range_max_m = 100"]);
}
