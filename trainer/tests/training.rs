//! A whole run on scans whose ray drop is known: it learns, it resumes to the same bits, it publishes.

use std::path::{Path, PathBuf};

use lidar::formats::Limits;
use lidar::{Sensor, formats, ray_drop};
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, cast};
use trainer::config::TrainConfig;
use trainer::export;
use trainer::exported::{self, Asked};
use trainer::train::{Run, best_network, checkpoint, train};

type Fact = Result<(), Box<dyn std::error::Error>>;

/// Four scans by a sensor that loses rays with range: 2 % at 0 m, 62 % at 40 m; its reflectance is a third of the surface's.
fn lossy_scans(folder: &Path) -> Fact {
    let sensor = Sensor::builtin("vlp16")?.with_columns(256)?;
    std::fs::create_dir_all(folder)?;
    for seed in 0..4 {
        let world = street(seed, &StreetConfig::default());
        let mut cloud = cast(&world, &sensor, &Pose::default(), &Motion::default()).cloud;
        let mut u = vec![0.0; cloud.len()];
        ray_drop::uniform(seed, 0, cloud.len(), &mut u);
        let kept: Vec<u32> =
            (0..cloud.len() as u32).filter(|i| u[*i as usize] > 0.02 + 0.015 * cloud.range_m(*i as usize)).collect();
        for intensity in &mut cloud.intensity {
            *intensity /= 3.0;
        }
        formats::write(&folder.join(format!("{seed}.ply")), &cloud.select(&kept))?;
    }
    Ok(())
}

fn config(steps: usize) -> Result<TrainConfig, Box<dyn std::error::Error>> {
    let data = |table: &str| format!("[[{table}]]\npath = \"scans\"\nsource = \"made up\"\nlicence = \"MIT\"\n");
    let text = format!(
        "name = \"toy\"\nsummary = \"A toy\"\nlicence = \"MIT\"\nsensor = \"vlp16\"\ncolumns = 256\n\
         [network]\nchannels = [16, 16, 16, 16]\n\
         [schedule]\nsteps = {steps}\nbatch = 2\ncrop_columns = 128\nlearning_rate = 5e-3\ncheckpoint_every = {steps}\n{}{}{}",
        data("train"),
        data("validate"),
        data("test")
    );
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("config.toml");
    std::fs::write(&path, text)?;
    Ok(TrainConfig::read(&path)?)
}

fn run(root: &Path, name: &str, resume: bool, stop_after: Option<usize>) -> Run {
    Run { out: root.join(name), data: root.into(), resume, stop_after }
}

fn newest(out: &Path) -> Result<PathBuf, Box<dyn std::error::Error>> {
    Ok(checkpoint::newest(out)?.ok_or("no checkpoint")?)
}

#[test]
fn it_learns_that_far_rays_are_lost_and_what_the_sensor_makes_of_reflectance() -> Fact {
    let root = tempfile::tempdir()?;
    lossy_scans(&root.path().join("scans"))?;
    let config = config(150)?;
    let scores = train(&config, &run(root.path(), "run", false, None))?.ok_or("the run did not end")?;
    assert!(scores.keep_log_loss.model < scores.keep_log_loss_of_constant, "{scores:?}");
    assert!(scores.keep_auc.model > 0.6, "{scores:?}");
    assert!(scores.reflectance_mae.model < scores.reflectance_mae.pass_through, "{scores:?}");

    // What it learned becomes a version, then the next one.
    let (network, card) = export::finish(&config, &root.path().join("run"), root.path(), &scores)?;
    let onnx = export::to_onnx(&network, &card)?;
    let models = root.path().join("models");
    assert!(export::publish(&models, &card, &onnx)?.ends_with("toy/1"));
    assert!(export::publish(&models, &card, &onnx)?.ends_with("toy/2"));
    assert_eq!(std::fs::read(models.join("toy/2/model.onnx"))?, onnx);
    assert!(std::fs::read_to_string(models.join("toy/2/card.md"))?.contains("keep log-loss"));

    // The file alone scores what its run did, on a grid of other columns something else; nothing scores fewer than its multiple.
    let score = |columns: Option<usize>| {
        exported::score(&onnx, &root.path().join("scans"), Asked { columns, ..Asked::default() })
    };
    let of_file = score(None)?;
    for (file, run) in of_file.to_card().iter().zip(scores.to_card()) {
        assert_eq!((&file.metric, file.scans), (&run.metric, run.scans));
        assert!(
            (file.model - run.model).abs() < 1e-4 && (file.pass_through - run.pass_through).abs() < 1e-9,
            "{file:?} {run:?}"
        );
    }
    assert_ne!(score(Some(200))?, of_file);
    assert!(score(Some(4)).is_err());
    assert!(exported::score(b"no model", root.path(), Asked::default()).is_err());

    // What a vehicle hides from ten scans, some columns of the lowest rings, is lost to all; then nothing is asked of it.
    let scans = root.path().join("on-a-vehicle");
    std::fs::create_dir_all(&scans)?;
    let cloud = formats::read(&root.path().join("scans/0.ply"), &Limits::default())?;
    let hidden = |i: usize| cloud.x[i] > 0.0 && cloud.y[i].abs() < 0.1 * cloud.x[i] && cloud.z[i] < -0.2 * cloud.x[i];
    let seen: Vec<u32> = (0..cloud.len() as u32).filter(|i| !hidden(*i as usize)).collect();
    for scan in 0..10 {
        formats::write(&scans.join(format!("{scan}.ply")), &cloud.select(&seen))?;
    }
    let reported = |without_own_vehicle: bool| -> anyhow::Result<f64> {
        Ok(exported::score(&onnx, &scans, Asked { without_own_vehicle, ..Asked::default() })?.keep_share)
    };
    assert!(reported(true)? > reported(false)? + 1e-3, "{} {}", reported(true)?, reported(false)?);
    Ok(())
}

/// Runs the binary in a process of its own, as a user does: Burn's random weights come from one generator a process.
fn train_apart(root: &Path, out: &str, arguments: &[&str]) -> Fact {
    let config = root.join("config.toml");
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_realbeam-trainer"))
        .arg("train")
        .arg(&config)
        .arg("--data")
        .arg(root)
        .arg("--out")
        .arg(root.join(out))
        .args(arguments)
        .output()?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned().into());
    }
    Ok(())
}

#[test]
fn a_run_that_was_stopped_and_resumed_ends_in_the_same_bits() -> Fact {
    let root = tempfile::tempdir()?;
    lossy_scans(&root.path().join("scans"))?;
    let config = config(6)?;
    std::fs::write(root.path().join("config.toml"), config.to_toml()?)?;
    train_apart(root.path(), "whole", &[])?;
    train_apart(root.path(), "parts", &["--stop-after", "3"])?;
    train_apart(root.path(), "parts", &["--resume"])?;
    let onnx = |run: &str| -> Result<Vec<u8>, Box<dyn std::error::Error>> {
        let weights = newest(&root.path().join(run))?.join("network.bpk");
        let network = config.network.init(config.sensor()?.rings().len(), &burn::tensor::Device::flex());
        let network = checkpoint::load_network(&weights, network)?;
        let scores = serde_json::from_slice(&std::fs::read(root.path().join(run).join("scores.json"))?)?;
        let (_, card) = export::finish(&config, &root.path().join(run), root.path(), &scores)?;
        Ok(export::to_onnx(&network, &card)?)
    };
    assert!(onnx("whole")? == onnx("parts")?, "the networks differ");
    Ok(())
}

#[test]
fn a_run_is_neither_overwritten_nor_resumed_with_another_config() -> Fact {
    let root = tempfile::tempdir()?;
    lossy_scans(&root.path().join("scans"))?;
    train(&config(2)?, &run(root.path(), "run", false, Some(1)))?;
    let again = train(&config(2)?, &run(root.path(), "run", false, None));
    assert!(again.is_err_and(|e| e.to_string().contains("--resume")));
    let other = train(&config(4)?, &run(root.path(), "run", true, None));
    assert!(other.is_err_and(|e| e.to_string().contains("config differs")));
    Ok(())
}

#[test]
fn damaged_weights_are_an_error_and_never_a_random_network() -> Fact {
    let root = tempfile::tempdir()?;
    lossy_scans(&root.path().join("scans"))?;
    let config = config(1)?;
    let run = run(root.path(), "run", false, None);
    train(&config, &run)?;
    let path = run.out.join("best.bpk");
    let whole = std::fs::read(&path)?;
    for length in [0, 100, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&path, &whole[..length])?;
        assert!(best_network(&config, &run.out).is_err(), "{length} of {} bytes", whole.len());
    }
    Ok(())
}

#[test]
fn the_shipped_models_configs_are_valid_and_name_the_shipped_licences() -> Fact {
    for (name, licence) in [("hdl64e", "CC-BY-NC-SA-3.0"), ("hdl32e", "Apache-2.0")] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(name).with_extension("toml");
        let config = TrainConfig::read(&path)?;
        assert_eq!((config.name.as_str(), config.licence.as_str()), (name, licence));
        assert!(config.train.iter().all(|data| data.licence == licence), "{name}: no data under a stricter licence");
    }
    Ok(())
}
