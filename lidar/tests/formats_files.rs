//! Clouds in files: found by name, with their labels, and never half written.

use std::fs;
use std::path::Path;

use lidar::PointCloud;
use lidar::formats::{Format, FormatError, Limits, encode, encode_labels, read, write};

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn cloud() -> PointCloud {
    PointCloud { x: vec![1.0, 2.0], y: vec![0.5; 2], z: vec![0.0; 2], intensity: vec![0.25; 2], ..PointCloud::new(1.0) }
}

fn names(folder: &Path) -> Result<Vec<String>, std::io::Error> {
    let mut names: Vec<_> = fs::read_dir(folder)?
        .map(|e| Ok(e?.file_name().to_string_lossy().into_owned()))
        .collect::<Result<_, std::io::Error>>()?;
    names.sort();
    Ok(names)
}

#[test]
fn every_format_goes_through_a_file_and_leaves_nothing_beside_it() -> Outcome {
    let folder = tempfile::tempdir()?;
    for format in Format::ALL {
        let path = folder.path().join(format!("scan.{}", format.extension()));
        write(&path, &cloud())?;
        write(&path, &cloud())?;
        let read = read(&path, &Limits::default())?;
        assert_eq!((read.x, read.y), (cloud().x, cloud().y), "{format:?}");
    }
    assert_eq!(names(folder.path())?.len(), Format::ALL.len());
    Ok(())
}

#[test]
fn labels_are_found_beside_the_scan_and_in_semantickittis_folder() -> Outcome {
    let folder = tempfile::tempdir()?;
    fs::create_dir(folder.path().join("velodyne"))?;
    fs::create_dir(folder.path().join("labels"))?;
    let scan = folder.path().join("velodyne/000000.bin");
    write(&scan, &cloud())?;
    assert_eq!(read(&scan, &Limits::default())?.label, None);
    fs::write(folder.path().join("labels/000000.label"), encode_labels(&[10, 40]))?;
    assert_eq!(read(&scan, &Limits::default())?.label, Some(vec![10, 40]));
    write(&scan, &PointCloud { label: Some(vec![70, 71]), ..cloud() })?;
    assert_eq!(names(&folder.path().join("velodyne"))?, ["000000.bin", "000000.label"]);
    assert_eq!(read(&scan, &Limits::default())?.label, Some(vec![70, 71]));
    Ok(())
}

#[test]
fn labels_of_another_scan_are_an_error_that_names_their_file() -> Outcome {
    let folder = tempfile::tempdir()?;
    let scan = folder.path().join("a.bin");
    write(&scan, &cloud())?;
    fs::write(folder.path().join("a.label"), [0; 4])?;
    let error = read(&scan, &Limits::default()).map_err(|error| error.to_string());
    assert!(error.is_err_and(|error| error.contains("a.label: labels at byte 0")));
    Ok(())
}

#[test]
fn a_failed_write_leaves_the_old_file() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("scan.las");
    write(&path, &cloud())?;
    let old = fs::read(&path)?;
    let unwritable = PointCloud { x: vec![f32::INFINITY, 0.0], ..cloud() };
    assert!(write(&path, &unwritable).is_err());
    assert_eq!(fs::read(&path)?, old);
    assert!(matches!(write(&folder.path().join("none/scan.ply"), &cloud()), Err(FormatError::Io { .. })));
    assert_eq!(names(folder.path())?, ["scan.las"]);
    Ok(())
}

#[test]
fn a_file_of_more_points_than_accepted_is_not_read_to_its_end() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("long.bin");
    fs::File::create(&path)?.set_len(1 << 34)?;
    let error = read(&path, &Limits { max_points: 1000, ..Limits::default() });
    assert!(matches!(error, Err(FormatError::TooMany { .. })));
    assert!(matches!(read(&folder.path().join("scan.txt"), &Limits::default()), Err(FormatError::UnknownName { .. })));
    Ok(())
}

#[test]
fn the_same_cloud_is_the_same_bytes() -> Outcome {
    for format in Format::ALL {
        assert_eq!(encode(format, &cloud())?, encode(format, &cloud())?, "{format:?}");
    }
    Ok(())
}
