//! Sets without twins.

use super::*;

#[test]
fn an_unpaired_set_needs_no_twins() {
    let dir = sound().write();
    for frame in 1..FRAMES {
        fs::remove_file(dir.path().join(format!("measured/{frame:06}.ply"))).unwrap();
    }
    fs::rename(dir.path().join("measured/000000.ply"), dir.path().join("measured/real.ply")).unwrap();
    let read = |sensor| UnpairedSet::read(&dir.path().join("measured"), &dir.path().join("sim"), sensor);
    let set = read(None).unwrap();
    assert_eq!((set.measured.len(), set.simulated.len(), set.name.as_str()), (1, FRAMES, "measured"));
    assert_eq!((set.measured[0].name.as_str(), set.measured[0].scene), ("real", 0));
    assert!(
        set.has_labels && set.notes.iter().any(|note| note.starts_with("measured: 1 of 3 scenes")),
        "{:?}",
        set.notes
    );
    let halved = sensor_of(elevations_deg(), 128);
    assert!(read(Some(&halved)).is_err_and(|e| e.to_string().contains("256 columns a turn")));
}

#[test]
fn an_unpaired_scan_in_another_unit_is_told() {
    let dir = sound().each_measured(|cloud| scale(cloud, 100.0)).write();
    let read = UnpairedSet::read(&dir.path().join("measured"), &dir.path().join("sim"), None);
    assert!(read.is_err_and(
        |e| e.to_string().contains("measured/000000.ply: x, y, z") && e.to_string().contains("centimetres")
    ));
}
