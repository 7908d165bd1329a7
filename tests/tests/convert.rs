//! Batch conversion is the service's pipeline on files.

use std::path::Path;
use std::process::{Command, Output};

use lidar::formats::{self, Format, Limits};
use tests::{RunningServer, binary, models};

type Fact = Result<(), Box<dyn std::error::Error>>;

fn server(arguments: &[&str], paths: &[&Path]) -> Result<Output, Box<dyn std::error::Error>> {
    let mut command = Command::new(binary("realbeam-server")?);
    Ok(command.args(arguments).env("REALBEAM_MODELS", models()).args(paths).output()?)
}

fn data(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data").join(name)
}

#[test]
fn a_converted_file_is_what_the_service_answers() -> Fact {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("out.ply");
    let output = server(&["convert", "--model", "hdl32e", "--seed", "9"], &[&data("hdl32e.npy"), &out])?;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let running = RunningServer::start(&models(), &["--default-model", "hdl32e"])?;
    let headers = [("content-type", "application/x-npy"), ("accept", "model/x-ply")];
    let answer = running.client().scan("?seed=9", &headers, &std::fs::read(data("hdl32e.npy"))?)?;
    assert!(answer.body == std::fs::read(&out)?, "the same bytes");
    Ok(())
}

#[test]
fn labels_beside_a_kitti_scan_ride_along() -> Fact {
    let folder = tempfile::tempdir()?;
    let mut cloud = formats::read(&data("hdl32e.bin"), &Limits::default())?;
    cloud.label = Some((0..cloud.len() as u32).map(|i| (i << 16) + 40).collect());
    formats::write(&folder.path().join("in.bin"), &cloud)?;
    let output = server(
        &["convert", "--model", "hdl32e"],
        &[&folder.path().join("in.bin"), &folder.path().join("out/scan.bin")],
    )?;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let after = formats::read(&folder.path().join("out/scan.bin"), &Limits::default())?;
    let labels = after.label.ok_or("labels beside the answer")?;
    assert!(!labels.is_empty() && labels.len() < cloud.len());
    for (i, label) in labels.iter().enumerate() {
        let from = (label >> 16) as usize;
        // The point that carries the label is the one that had it: on the same side, about as far.
        assert!((after.y[i] - cloud.y[from]).abs() < 0.06 * cloud.range_m(from));
    }
    Ok(())
}

#[test]
fn a_folder_is_converted_file_by_file_and_a_bad_one_is_named() -> Fact {
    let folder = tempfile::tempdir()?;
    let (from, to) = (folder.path().join("in"), folder.path().join("out"));
    std::fs::create_dir_all(&from)?;
    for name in ["hdl32e.bin", "hdl32e.laz"] {
        std::fs::copy(data(name), from.join(name))?;
    }
    std::fs::write(from.join("broken.ply"), b"ply\nformat ascii 1.0\nelement vertex 9\n")?;
    let output = server(&["convert", "--model", "hdl32e"], &[&from, &to])?;
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("broken.ply"), "{said}");
    for name in ["hdl32e.bin", "hdl32e.laz"] {
        let after = formats::read(&to.join(name), &Limits::default())?;
        assert!(!after.is_empty(), "{name}");
    }
    assert!(!to.join("broken.ply").exists());
    let left: Vec<_> = std::fs::read_dir(&to)?.collect::<Result<_, _>>()?;
    assert_eq!(left.len(), 2, "nothing half-written stays behind");
    Ok(())
}

#[test]
fn a_model_says_what_it_is() -> Fact {
    let output = server(&["inspect", "hdl64e"], &[])?;
    let text = String::from_utf8(output.stdout)?;
    for wanted in ["HDL-64E", "CC-BY-NC-SA", "scan", "range", "reflectance", "keep", "keep log-loss"] {
        assert!(text.contains(wanted), "`{wanted}` in:\n{text}");
    }
    Ok(())
}

#[test]
fn every_format_that_is_read_can_be_converted_to() -> Fact {
    let folder = tempfile::tempdir()?;
    for format in Format::ALL {
        let out = folder.path().join(format!("scan.{}", format.extension()));
        let output = server(&["convert", "--model", "hdl32e"], &[&data("hdl32e.npz"), &out])?;
        assert!(output.status.success(), "{}: {}", format.name(), String::from_utf8_lossy(&output.stderr));
        assert!(!formats::read(&out, &Limits::default())?.is_empty(), "{}", format.name());
    }
    Ok(())
}
