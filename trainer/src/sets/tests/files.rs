//! Files that are missing, damaged or too many.

use super::*;

#[test]
fn missing_parts_are_named() {
    let dir = sound().write();
    refused(PairedSet::read(&dir.path().join("nowhere")), None, &["nowhere: missing"]);
    fs::remove_dir_all(dir.path().join("measured")).unwrap();
    refused(PairedSet::read(dir.path()), None, &["measured: missing; expected the folder of measured scans"]);
    fs::remove_dir_all(dir.path().join("sim")).unwrap();
    refused(PairedSet::read(dir.path()), None, &["sim: missing; expected the folder of simulated scans"]);
    fs::remove_file(dir.path().join("sensor.toml")).unwrap();
    refused(PairedSet::read(dir.path()), None, &["sensor.toml: missing", "elevation_deg"]);
}

#[test]
fn folders_without_scans_are_refused() {
    let dir = sound().write();
    for frame in 0..FRAMES {
        fs::remove_file(dir.path().join(format!("sim/{frame:06}.ply"))).unwrap();
    }
    refused(PairedSet::read(dir.path()), None, &["sim: no scan"]);
}

#[test]
fn a_sensor_file_is_refused_by_its_field() {
    let dir = sound().write();
    let path = dir.path().join("sensor.toml");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("columns = 256", "columns = 0")).unwrap();
    refused(PairedSet::read(dir.path()), None, &["sensor.toml", "columns is 0"]);
    fs::write(&path, text.replace("range_max_m = ", "range_max = ")).unwrap();
    refused(PairedSet::read(dir.path()), None, &["sensor.toml", "range_max"]);
    fs::write(&path, "columns = = 3").unwrap();
    refused(PairedSet::read(dir.path()), None, &["sensor.toml", "line 1"]);
}

#[test]
fn frames_without_a_partner_are_named_on_both_sides() {
    let dir = sound().write();
    fs::remove_file(dir.path().join("measured/000002.ply")).unwrap();
    refused(PairedSet::read(dir.path()), None, &["without a partner: 1 of sim/ not in measured/ (000002)"]);
    for frame in 100..107 {
        put(&dir.path().join(format!("measured/{frame:06}.ply")), &sound().measured[0]);
    }
    let words = ["(000002)", "7 of measured/ not in sim/ (000100, 000101, 000102, 000103, 000104, …)"];
    refused(PairedSet::read(dir.path()), None, &words);
}

#[test]
fn one_frame_in_two_formats_is_refused() {
    let dir = sound().write();
    put(&dir.path().join("sim/000000.pcd"), &sound().simulated[0]);
    refused(PairedSet::read(dir.path()), None, &["000000.pcd", "000000.ply", "twice"]);
}

#[test]
fn a_damaged_scan_is_named() {
    let dir = sound().write();
    fs::write(
        dir.path().join("measured/000004.ply"),
        "ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\n",
    )
    .unwrap();
    refused(PairedSet::read(dir.path()), None, &["measured/000004.ply"]);
}

#[test]
fn a_list_of_scenes_has_a_line_a_frame() {
    let dir = sound().write();
    fs::write(dir.path().join("scenes.txt"), "a\nb\n").unwrap();
    refused(PairedSet::read(dir.path()), None, &["scenes.txt: 2 lines; expected 6 lines"]);
    fs::write(dir.path().join("scenes.txt"), "a\n\nb\nb\nc\nc\n").unwrap();
    refused(PairedSet::read(dir.path()), None, &["scenes.txt: line 2 is empty"]);
}

#[test]
fn frames_in_memory_must_fit_the_sensor() {
    let set = accepted(&sound());
    let with = |frame: Frame| PairedSet::from_frames("demo", set.sensor.clone(), set.scenes.clone(), vec![frame]);
    let small = Frame { measured: RangeImage::empty(16, 8), ..set.frames[0].clone() };
    refused(with(small), None, &["frame `000000`: measured is 16 rings × 8 columns, expected 16 rings × 256 columns"]);
    refused(with(Frame { scene: 3, ..set.frames[0].clone() }), None, &["scene is 3"]);
    let empty = Frame { measured: RangeImage::empty(16, 256), ..set.frames[0].clone() };
    refused(with(empty), Some(DefectKind::NoReturns), &["demo/measured/000000"]);
    assert!(with(set.frames[0].clone()).is_ok());
}

#[test]
fn a_set_that_no_memory_holds_is_refused_before_it_is_read() {
    assert!(paired::check_size(24, 2 * 64 * 2048).is_ok());
    let error = paired::check_size(9000, 2 * 1024 * 16_384).unwrap_err().to_string();
    assert!(error.starts_with("9000 frames") && error.contains("fewer `columns`"), "{error}");
}
