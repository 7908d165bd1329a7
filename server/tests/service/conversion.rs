//! Conversion of files gives what the service gives.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use lidar::formats::{self, Format, Limits};
use server::convert::{ConvertError, seed_of_file};
use server::{Chance, Conversion, MAX_MODEL_BYTES, Model, Noise, convert};

use crate::support::{Result, Service, bin, data, scan};

fn conversion() -> Result<Conversion> {
    let model = Model::read(&data().join("models/passthrough/2/model.onnx"), MAX_MODEL_BYTES)?;
    let chance = Chance { seed: 5, noise: Noise::Drawn };
    Ok(Conversion { model: Arc::new(model), chance, frame: None, limits: Limits::default(), threads: 1 })
}

/// Two scans as `.bin`, one below the other.
fn two_scans(folder: &Path) -> Result<[Vec<u8>; 2]> {
    let first = bin()?;
    let second = formats::encode(Format::Kitti, &scan().select(&(100..4000).collect::<Vec<_>>()))?;
    fs::create_dir_all(folder.join("drive"))?;
    fs::write(folder.join("000000.bin"), &first)?;
    fs::write(folder.join("drive/000001.bin"), &second)?;
    Ok([first, second])
}

#[test]
fn a_file_converts_to_the_services_answer() -> Result {
    let folder = tempfile::tempdir()?;
    let [first, _] = two_scans(folder.path())?;
    let service = Service::start()?;
    let (from, to) = (folder.path().join("000000.bin"), folder.path().join("out/000000.bin"));
    assert_eq!(convert(&conversion()?, &from, &to)?, 1);
    assert!(fs::read(&to)? == service.scan("?seed=5", &[], &first)?.success()?);
    let median = Conversion { chance: Chance { seed: 5, noise: Noise::Median }, ..conversion()? };
    convert(&median, &from, &to)?;
    assert!(fs::read(&to)? == service.scan("?seed=5&noise=median", &[], &first)?.success()?);
    let to = folder.path().join("out/000000.npy");
    convert(&conversion()?, &from, &to)?;
    let answer = service.scan("?seed=5", &[("accept", "application/x-npy")], &first)?;
    assert!(fs::read(&to)? == answer.success()?);
    Ok(())
}

#[test]
fn a_folder_converts_file_by_file_each_with_a_seed_from_its_content() -> Result {
    let folder = tempfile::tempdir()?;
    let (from, to) = (folder.path().join("in"), folder.path().join("out"));
    let bodies = two_scans(&from)?;
    fs::write(from.join("readme.txt"), "no scan")?;
    assert_eq!(convert(&conversion()?, &from, &to)?, 2);
    let service = Service::start()?;
    for (name, body) in ["000000.bin", "drive/000001.bin"].into_iter().zip(bodies) {
        let answer = service.scan(&format!("?seed={}", seed_of_file(5, &body)), &[], &body)?.success()?;
        assert!(fs::read(to.join(name))? == answer, "{name}");
    }
    assert_eq!(fs::read_dir(&to)?.count(), 2, "nothing but the results");
    Ok(())
}

#[test]
fn files_that_fail_are_reported_and_the_others_converted() -> Result {
    let folder = tempfile::tempdir()?;
    let (from, to) = (folder.path().join("in"), folder.path().join("out"));
    two_scans(&from)?;
    fs::write(from.join("cut.bin"), [0; 17])?;
    fs::write(from.join("cut.ply"), "ply")?;
    let Err(error) = convert(&conversion()?, &from, &to) else { return Err("two files are broken".into()) };
    let ConvertError::Some { files: 4, failed } = error else { return Err(error.into()) };
    assert!(
        failed.len() == 2 && failed[0].contains("cut.bin: scan: ") && failed[1].contains("cut.ply: scan: "),
        "{failed:?}"
    );
    assert!(to.join("000000.bin").is_file() && to.join("drive/000001.bin").is_file());
    assert!(!to.join("cut.bin").exists(), "a failed file leaves nothing");
    Ok(())
}

#[test]
fn scans_are_never_overwritten_by_their_results() -> Result {
    let folder = tempfile::tempdir()?;
    let [first, _] = two_scans(folder.path())?;
    let file = folder.path().join("000000.bin");
    for (from, to) in
        [(&file, &file), (&file, &folder.path().into()), (&folder.path().into(), &folder.path().join("drive/.."))]
    {
        let refused = convert(&conversion()?, from, to);
        assert!(matches!(refused, Err(ConvertError::SamePlace { .. })), "{} to {}", from.display(), to.display());
    }
    assert!(fs::read(&file)? == first);
    let error = convert(&conversion()?, &file, &folder.path().join("out.txt")).map_err(|e| e.to_string());
    assert!(error.is_err_and(|e| e.ends_with("out.txt: the name tells no point cloud format")));
    let empty = tempfile::tempdir()?;
    assert!(matches!(convert(&conversion()?, empty.path(), folder.path()), Err(ConvertError::NoScans { .. })));
    Ok(())
}
