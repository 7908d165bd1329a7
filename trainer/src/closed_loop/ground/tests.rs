//! Known offsets of the elevation come out; none comes out as none.

#![allow(clippy::unwrap_used, reason = "a test that panics is a test that fails")]

use hidden::{Geometry, Recipe, frame};
use scene::Pose;
use scene::street::{StreetConfig, street};

use super::*;

/// A drive of twelve metres through each of three streets by a sensor whose rays point so much higher than it says.
fn drive(offset_deg: f64, pitch_deg: f64) -> GroundReport {
    let sensor = Sensor::builtin("hdl64e").unwrap().with_columns(1024).unwrap();
    let hidden = vec![Geometry::ElevationOffset { offset_deg }.into(), Geometry::MountPitch { pitch_deg }.into()];
    let recipe = Recipe::new(1, sensor.clone(), hidden);
    let mut scans = Vec::new();
    for seed in 0..3 {
        let street = street(40 + seed, &StreetConfig { reach_m: 90.0, ..StreetConfig::default() });
        for step in 0..7 {
            let pose = Pose::above_ground(&street, 1.3 * step as f32 - 4.0, 0.0, 0.02).unwrap();
            scans.push((seed as usize, frame(&recipe, &street, &pose, scans.len()).1));
        }
    }
    let scans: Vec<(usize, &RangeImage)> = scans.iter().map(|(scene, image)| (*scene, image)).collect();
    let report = measure(&scans, &sensor);
    println!("{offset_deg}°: {report:?}");
    report
}

#[test]
fn ground_seen_twice_tells_the_elevation_offset_and_no_lean() {
    for (offset_deg, pitch_deg) in [(0.0, 0.3), (0.2, 0.0), (-0.15, -0.3)] {
        let found = drive(offset_deg, pitch_deg).registered.unwrap();
        assert!(found.stderr_deg < 0.03, "{found:?}");
        assert!((found.offset_deg - offset_deg).abs() < 0.04, "{found:?} for {offset_deg}°");
    }
}
