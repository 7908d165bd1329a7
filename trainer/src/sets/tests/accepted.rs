//! What is right is read, and real effects, however strong, are no errors.

use super::*;

#[test]
fn a_sound_set_is_read_whole_and_without_a_note() {
    let set = accepted(&sound());
    assert_eq!((set.frames.len(), set.scenes.len(), set.has_labels, set.rotation_hz), (FRAMES, 3, true, 10.0));
    assert_eq!(set.notes, Vec::<String>::new());
    let frame = &set.frames[3];
    assert_eq!((frame.name.as_str(), frame.scene, frame.measured_extra), ("000003", 1, 0));
    assert_eq!(frame.simulated.returns(), sound().simulated[3].len());
    assert_eq!(frame.simulated.range_m(), frame.measured.range_m());
    assert!(frame.simulated.class().iter().any(|c| *c > 0) && frame.measured.class().iter().all(|c| *c == 0));
}

#[test]
fn the_digest_is_of_the_scans_and_not_of_their_files() {
    let halves = sound();
    let dir = halves.write();
    let before = PairedSet::read(dir.path()).unwrap();
    fs::remove_file(dir.path().join("measured/000001.ply")).unwrap();
    put(&dir.path().join("measured/000001.pcd"), &halves.measured[1]);
    assert_eq!(PairedSet::read(dir.path()).unwrap().sha256, before.sha256, "another format, the same scans");
    let in_memory =
        PairedSet::from_frames("demo", before.sensor.clone(), before.scenes.clone(), before.frames.clone()).unwrap();
    assert_eq!(in_memory.sha256, before.sha256);
    let moved = halves.each_measured(|cloud| cloud.intensity[7] += 0.01).read().unwrap();
    assert_ne!(moved.sha256, before.sha256);
}

#[test]
fn a_sensor_file_without_a_rate_turns_ten_times_a_second() {
    let dir = sound().write();
    let path = dir.path().join("sensor.toml");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("rotation_hz = 10.0", "")).unwrap();
    let set = PairedSet::read(dir.path()).unwrap();
    assert_eq!(set.rotation_hz, 10.0);
    assert!(set.notes[0].contains("no rotation_hz"), "{:?}", set.notes);
}

#[test]
fn too_few_scenes_are_a_note_on_what_cannot_be_claimed() {
    let dir = sound().write();
    fs::write(dir.path().join("scenes.txt"), "a\na\na\nb\nb\nb\n").unwrap();
    let set = PairedSet::read(dir.path()).unwrap();
    assert_eq!(set.scenes, ["a", "b"]);
    assert!(set.notes.iter().any(|note| note.starts_with("2 of 3 scenes")), "{:?}", set.notes);
}

#[test]
fn frames_are_ordered_by_number() {
    let halves = sound();
    let dir = halves.write();
    for half in ["sim", "measured"] {
        for (frame, number) in [(4, 9), (5, 10)] {
            let path = |n: &str| dir.path().join(half).join(format!("{n}.ply"));
            fs::rename(path(&format!("{frame:06}")), path(&number.to_string())).unwrap();
        }
    }
    let set = PairedSet::read(dir.path()).unwrap();
    let names: Vec<&str> = set.frames.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["000000", "000001", "000002", "000003", "9", "10"]);
}

#[test]
fn scans_without_a_ring_field_are_read_by_elevation() {
    let halves = sound().each_measured(|cloud| {
        shuffle(cloud);
        cloud.ring = None;
    });
    let set = accepted(&halves);
    assert_eq!(set.notes, ["measured: 6 of 6 scans have no ring field: rings are told by elevation"]);
    assert_eq!(set.frames[2].simulated.range_m(), set.frames[2].measured.range_m());
}

#[test]
fn intensities_in_whole_bytes_are_what_they_are() {
    let halves = sound().each_measured(|c| {
        c.intensity.iter_mut().for_each(|i| *i = (*i * 255.0).round());
        c.full_scale = 255.0;
    });
    let set = accepted(&halves);
    assert!(set.notes[0].contains("6 of 6 scans have whole numbers as intensities"), "{:?}", set.notes);
    let pairs = set.frames[0].simulated.reflectance().iter().zip(set.frames[0].measured.reflectance());
    // Rounding to bytes.
    assert!(pairs.into_iter().all(|(s, m)| (s - m).abs() <= 0.5 / 255.0 + 1e-6));
}

#[test]
fn strong_effects_of_real_sensors_are_no_errors() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for gain in [0.5, 1.85] {
        let set = accepted(&sound().each_measured(|c| c.intensity.iter_mut().for_each(|i| *i *= gain)));
        assert!(set.frames[0].measured.reflectance().iter().any(|r| *r > 0.3), "gain {gain}: the scale is 0 to 1");
    }
    accepted(&sound().each_measured(|c| c.intensity.iter_mut().for_each(|i| *i = i.min(0.3))));
    accepted(&sound().each_measured(|c| c.intensity.iter_mut().for_each(|i| *i = *i * 1.5 - 0.05)));
    for offset_m in [-0.3, 0.3] {
        accepted(&sound().each_measured(|c| stretch(c, |r| r + offset_m)));
    }
    accepted(&sound().each_measured(|c| stretch(c, |r| 1.05 * r)));
    accepted(&sound().each_measured(|c| stretch(c, |r| r + 0.3 * (rng.random::<f32>() - 0.5))));
    accepted(&sound().each_measured(|c| drop_points(c, |_| rng.random::<f32>() < 0.5)));
    accepted(&sound().each_measured(|c| drop_points(c, |_| rng.random::<f32>() < 0.05)));
    let near = sound().each_measured(|c| {
        let near: Vec<bool> = (0..c.len()).map(|i| c.range_m(i) < 12.0).collect();
        drop_points(c, |i| near[i]);
    });
    accepted(&near);
    let sector = sound().each_measured(|c| {
        let ahead: Vec<bool> = (0..c.len()).map(|i| c.x[i] > c.y[i].abs()).collect();
        drop_points(c, |i| ahead[i]);
    });
    accepted(&sector);
    accepted(&sound().each_measured(|c| {
        let clutter: Vec<f32> = (0..c.len()).map(|_| rng.random()).collect();
        let mut i = 0;
        stretch(c, |r| {
            i += 1;
            if clutter[i - 1] < 0.2 { 2.0 + 300.0 * clutter[i - 1] } else { r }
        });
    }));
}

#[test]
fn a_sensor_that_points_elsewhere_by_half_a_degree_is_the_same_sensor() {
    let nominal = sensor_of(elevations_deg(), 256);
    for off_deg in [-0.5, 0.5] {
        let true_rays = cast_by(&sensor_of(elevations_deg().iter().map(|e| e + off_deg).collect(), 256));
        // Points where the sensor believes its rays to be: on the nominal ones.
        let mut projector =
            lidar::Projector::new(&sensor_of(elevations_deg().iter().map(|e| e + off_deg).collect(), 256));
        let on_nominal = |cloud: &PointCloud| projector.project(cloud).unwrap().image.to_cloud(&nominal);
        accepted(&Halves { measured: true_rays.iter().map(on_nominal).collect(), ..sound() });
        // And points that a calibration has put where they are.
        accepted(&Halves { measured: true_rays, ..sound() });
    }
}

#[test]
fn a_mount_that_leans_turns_or_moves_is_the_same_place() {
    let sensor = sensor_of(elevations_deg(), 256);
    let poses = [
        Pose { pitch_rad: 0.02, ..Pose::default() },
        Pose { roll_rad: -0.02, ..Pose::default() },
        Pose { yaw_rad: 0.05, ..Pose::default() },
    ];
    for lean in poses {
        for motion in [Motion::default(), Motion { velocity_m_s: [15.0, 0.0, 0.0], yaw_rate_rad_s: 0.3 }] {
            accepted(&Halves { measured: cast_from(&sensor, lean, motion), ..sound() });
        }
    }
}

#[test]
fn one_scan_measured_again_and_again_is_no_wrong_place() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let one = sound();
    let halves = Halves { simulated: vec![one.simulated[0].clone(); 4], measured: vec![one.measured[0].clone(); 4] };
    let halves = halves.each_measured(|c| stretch(c, |r| r + 0.05 * (rng.random::<f32>() - 0.5)));
    assert_eq!(accepted(&halves).scenes.len(), 2);
}

#[test]
fn second_returns_are_counted() {
    let halves = sound().each_measured(|cloud| {
        let mut behind = cloud.select(&[1, 2, 3, 4, 5]);
        scale(&mut behind, 1.5);
        for (to, from) in [(&mut cloud.x, behind.x), (&mut cloud.y, behind.y), (&mut cloud.z, behind.z)] {
            to.extend(from);
        }
        cloud.intensity.extend(behind.intensity);
        cloud.ring.as_mut().unwrap().extend(behind.ring.unwrap());
        cloud.time_s = None;
    });
    let within = |i: &usize| sound().measured[0].range_m(*i) * 1.5 <= 100.0;
    assert_eq!(accepted(&halves).frames[0].measured_extra, (1..6).filter(within).count());
}

#[test]
fn labels_that_not_every_scan_has_are_not_used() {
    let mut halves = sound();
    halves.simulated[4].label = None;
    let set = accepted(&halves);
    assert!(!set.has_labels && set.notes == ["sim: 5 of 6 scans have labels: none are used"], "{:?}", set.notes);
}
