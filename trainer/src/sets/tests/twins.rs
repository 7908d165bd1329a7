//! Twins that show another place, or the same from another side.

use super::*;

#[test]
fn left_handed_scans_are_told() {
    let halves = sound().each_measured(PointCloud::mirror_y);
    refused(halves.read(), Some(DefectKind::LeftHanded), &["measured/000000.ply: x, y, z: left-handed", "sign of y"]);
    let exchanged = sound().each_measured(|cloud| std::mem::swap(&mut cloud.x, &mut cloud.y));
    refused(exchanged.read(), Some(DefectKind::LeftHanded), &["measured/000000.ply", "exchanged"]);
}

#[test]
fn turned_scans_are_told_with_their_angle() {
    for (left_deg, back) in [(90.0, "by -90°"), (180.0, "by 180°"), (-45.0, "by 45°")] {
        let halves = sound().each_measured(|cloud| turn(cloud, left_deg));
        refused(halves.read(), Some(DefectKind::Turned), &["measured/000000.ply: x, y, z", back]);
    }
}

#[test]
fn twins_without_a_common_ray_are_refused() {
    let mut halves = sound();
    let few = halves.measured[2].len() / 50;
    drop_points(&mut halves.measured[2], |i| i < few);
    drop_points(&mut halves.simulated[2], |i| i >= few);
    refused(halves.read(), Some(DefectKind::NoOverlap), &["measured/000002.ply", "no overlap: 0 of 4096 rays"]);
}

#[test]
fn a_frame_that_shows_another_frame_is_told_which() {
    let mut halves = sound();
    halves.measured.swap(0, 3);
    refused(halves.read(), Some(DefectKind::NoOverlap), &["measured/000000.ply", "frame 000003", "numbered alike"]);
    let mut halves = sound();
    halves.measured.swap(4, 5);
    refused(halves.read(), Some(DefectKind::NoOverlap), &["measured/000004.ply", "frame 000005"]);
}

#[test]
fn scans_of_other_places_are_refused() {
    let mut halves = sound();
    let sensor = sensor_of(elevations_deg(), 256);
    for (k, cloud) in halves.measured.iter_mut().enumerate() {
        *cloud =
            cast(&street(50 + k as u64, &StreetConfig::default()), &sensor, &Pose::default(), &Motion::default()).cloud;
    }
    refused(halves.read(), Some(DefectKind::NoOverlap), &["measured/0000", "belong together"]);
}
