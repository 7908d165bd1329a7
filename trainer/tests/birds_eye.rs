//! Scans from above: what is translated looks more like the real ones, and what detectors learn from decides what they find.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use lidar::{PointCloud, formats};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use trainer::birds_eye::dataset;
use trainer::birds_eye::detection::{Question, detection};
use trainer::birds_eye::training::{best, evaluate, train};
use trainer::birds_eye::{BirdsEyeConfig, Footprint};
use trainer::train::Run;

type Fact = Result<(), Box<dyn std::error::Error>>;

/// Who holds it trains alone: the device's random numbers are everybody's.
static DEVICE: Mutex<()> = Mutex::new(());

const CAR: u32 = 10;
const VEGETATION: u32 = 70;

/// Three cars and three bushes on a road: of each car the two sides that the sensor sees, of a bush its leaves. What is labelled a car is
/// `car` of the two.
fn scan(seed: u64, reflectance: f32, labels: [u32; 2]) -> PointCloud {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut cloud = PointCloud { label: Some(vec![]), ..PointCloud::new(1.0) };
    let mut push = |x: f32, y: f32, z: f32, label: u32, rng: &mut ChaCha8Rng| {
        cloud.x.push(x);
        cloud.y.push(y);
        cloud.z.push(z);
        cloud.intensity.push((reflectance + rng.random_range(-0.05..0.05f32)).clamp(0.0, 1.0));
        cloud.label.get_or_insert_default().push(label);
    };
    for i in 0..600 {
        push(-7.9 + 0.8 * (i % 20) as f32, -7.9 + 0.5 * (i / 20) as f32, -1.7, 40, &mut rng);
    }
    for k in 0..6 {
        let place =
            [0, 1].map(|axis| -5.0 + 5.0 * f32::from([[0, 0], [1, 0], [2, 0], [0, 2], [1, 2], [2, 2]][k][axis] as u8));
        let center = place.map(|along| along + rng.random_range(-0.8..0.8f32));
        if k % 2 == 0 {
            let car = Footprint::new(center, [3.6, 1.7], rng.random_range(-0.3..0.3));
            let [a, b, c, _] = car.corners();
            for i in 0..90 {
                let (from, to) = if i % 3 == 0 { (b, c) } else { (a, b) };
                let part = rng.random::<f32>();
                let [x, y] = [0, 1].map(|axis| from[axis] + part * (to[axis] - from[axis]));
                push(x, y, -1.6 + 0.05 * (i % 30) as f32, labels[0], &mut rng);
            }
        } else {
            for i in 0..90 {
                let [x, y] = [0, 1].map(|axis| center[axis] + rng.random_range(-0.6..0.6f32));
                push(x, y, -1.6 + 0.02 * i as f32, labels[1], &mut rng);
            }
        }
    }
    cloud
}

fn write(folder: &Path, seeds: std::ops::Range<u64>, reflectance: f32, labels: [u32; 2]) -> Fact {
    std::fs::create_dir_all(folder)?;
    for seed in seeds {
        formats::write(&folder.join(format!("{seed:03}.ply")), &scan(seed, reflectance, labels))?;
    }
    Ok(())
}

fn config(extra: &str) -> Result<BirdsEyeConfig, Box<dyn std::error::Error>> {
    let text = format!(
        "seed = 3\n{extra}\n[grid]\nreach_m = 8.0\ncell_m = 0.5\nheight_m = [-2.0, 1.0]\n\
         [generator]\nwidth = 8\nblocks = 2\ngain = 1.0\nborder = \"mirror\"\ncondition = false\noutput = \"correction\"\n\
         [discriminator]\nwidth = 8\nhalvings = 1\ngain = 1.0\n[losses]\ncycle = 2.0\nidentity = 1.0\n\
         [schedule]\nsteps = 60\nbatch = 5\ncrop_columns = 32\nlearning_rate = 2e-3\naverage = 0.9\ncheckpoint_every = 30\nsamples_every = 30\n\
         [simulated]\ntrain = [\"simulated\"]\nvalidate = [\"simulated\"]\n[real]\ntrain = [\"real\"]\nvalidate = [\"real\"]\n\
         [detector]\nsteps = 400\nbatch = 4\nlearning_rate = 1e-2\nnetwork = {{ channels = [8, 8, 16, 16, 16] }}\n"
    );
    Ok(BirdsEyeConfig::from_table(toml::from_str(&text)?)?)
}

fn run(root: &Path, name: &str) -> Run {
    Run { out: root.join(name), data: root.to_owned(), resume: false, stop_after: None }
}

#[test]
fn every_config_is_read() -> Fact {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/birds-eye");
    let mut read = 0;
    for entry in std::fs::read_dir(folder)? {
        BirdsEyeConfig::read(&entry?.path())?;
        read += 1;
    }
    assert!(read >= 3, "{read}");
    Ok(())
}

/// The numbers of a table's row, from a column on.
fn numbers(table: &str, row: usize, from: usize) -> Vec<f64> {
    let line = table.lines().nth(row + 2).unwrap_or_default();
    line.split('|').skip(from + 1).filter_map(|cell| cell.trim().parse().ok()).collect()
}

#[test]
fn what_is_translated_is_nearer_to_real_and_a_stopped_run_goes_on_to_the_same_bits() -> Fact {
    let _alone = DEVICE.lock().unwrap_or_else(PoisonError::into_inner);
    let root = tempfile::tempdir()?;
    write(&root.path().join("simulated"), 0..6, 0.8, [CAR, VEGETATION])?;
    write(&root.path().join("real"), 50..56, 0.2, [CAR, VEGETATION])?;
    for ray_drop in [false, true] {
        let config = config(&format!("ray_drop = {ray_drop}"))?;
        let whole = run(root.path(), &format!("whole-{ray_drop}"));
        let table = train(&config, &whole)?.ok_or("not finished")?;
        let reflectance = numbers(&table, 1, 1);
        assert!(reflectance[1] < 0.7 * reflectance[0], "{table}");
        assert!(whole.out.join("samples/0000060.png").is_file());

        if ray_drop {
            let parts = run(root.path(), "parts");
            assert!(train(&config, &Run { stop_after: Some(30), ..parts.clone() })?.is_none());
            assert!(train(&config, &parts).is_err_and(|e| e.to_string().contains("holds a run already")));
            train(&config, &Run { resume: true, ..parts.clone() })?;
            let log = |run: &Run| std::fs::read_to_string(run.out.join("log.jsonl"));
            assert_eq!(log(&whole)?, log(&parts)?);
            assert_eq!(
                (evaluate(&whole.out, root.path())?, evaluate(&parts.out, root.path())?),
                (table.clone(), table)
            );
        }

        // Where cells are lost apart from the image, nothing is invented in empty ones, and seeds draw which are lost.
        let (of_run, translator) = best(&whole.out)?;
        let cloud = scan(99, 0.8, [CAR, VEGETATION]);
        let returns = (0..cloud.len()).map(|i| [cloud.x[i], cloud.y[i], cloud.z[i], cloud.intensity[i]]);
        let before = of_run.grid.see(returns);
        let after = translator.translate(&before, 1);
        let cells = 0..before.cells * before.cells;
        let invented = cells.filter(|i| after.occupied(*i) && !before.occupied(*i)).count();
        assert!(!ray_drop || invented == 0, "{invented}");
        assert_eq!(after, translator.translate(&before, 1));
        assert_eq!(after != translator.translate(&before, 2), ray_drop);
    }
    Ok(())
}

#[test]
fn detectors_find_what_they_learned_to_be_a_vehicle() -> Fact {
    let _alone = DEVICE.lock().unwrap_or_else(PoisonError::into_inner);
    let root = tempfile::tempdir()?;
    let path = |name: &str| root.path().join(name);
    write(&path("like"), 0..40, 0.3, [CAR, VEGETATION])?;
    write(&path("unlike"), 0..40, 0.3, [VEGETATION, CAR])?;
    write(&path("labelled"), 80..84, 0.3, [CAR, VEGETATION])?;
    let config = config("")?;
    let question = |through: Vec<PathBuf>| Question { real: path("labelled"), through, seeds: vec![1] };
    let answer = detection(&config, &[path("like"), path("unlike")], &question(vec![]))?;
    let table = &answer.table;
    let [like, unlike] = [0, 1].map(|row| numbers(table, row, 1));
    // Scans, four distances, their mean, the overlap.
    assert_eq!((like.len(), like[0]), (7, 40.0), "{table}");
    // Within a metre, two cells, and by the overlap.
    assert!(like[2] > 0.7 && like[6] > 0.5 && unlike[2] < 0.2 && unlike[6] < 0.2, "{table}");
    assert!((like[1..5].iter().sum::<f64>() / 4.0 - like[5]).abs() < 2e-3, "{table}");
    assert!(table.contains("12 vehicles in 4 real scans; 400 steps"), "{table}");
    assert!(answer.picture.starts_with(b"\x89PNG"));

    let refusal = |folder: &str, question: Question| {
        detection(&config, &[path(folder)], &question).map_or_else(|e| format!("{e:#}"), |_| String::new())
    };
    write(&path("bare"), 0..1, 0.3, [VEGETATION, VEGETATION])?;
    assert!(refusal("bare", question(vec![])).contains("none of the labels is a vehicle's"));
    assert!(refusal("nowhere", question(vec![])).contains("nowhere"));
    assert!(refusal("like", question(vec![path("no-run")])).contains("no-run"));
    Ok(())
}

#[test]
fn detectors_learn_from_what_a_run_makes_of_scans_if_both_see_alike() -> Fact {
    let _alone = DEVICE.lock().unwrap_or_else(PoisonError::into_inner);
    let root = tempfile::tempdir()?;
    let path = |name: &str| root.path().join(name);
    write(&path("simulated"), 0..3, 0.8, [CAR, VEGETATION])?;
    write(&path("real"), 50..53, 0.2, [CAR, VEGETATION])?;
    let mut config = config("")?;
    (config.schedule.steps, config.schedule.checkpoint_every, config.detector.steps) = (2, 2, 150);
    let run = run(root.path(), "run");
    train(&config, &run)?;
    let question = Question { real: path("real"), through: vec![run.out.clone()], seeds: vec![1, 2] };
    let table = detection(&config, &[path("simulated")], &question)?.table;
    assert!(table.lines().nth(3).is_some_and(|line| line.contains("simulated, through ")), "{table}");
    assert!(table.lines().nth(2).is_some_and(|line| line.contains(" ± ")), "{table}");
    let scores = |row: usize| table.lines().nth(2 + row).map(|line| line.split(" | 3 | ").nth(1));
    assert_ne!(scores(0), scores(1), "detectors of their own: {table}");

    // The same as files.
    let files = dataset::write(&config, &path("simulated"), Some(&run.out), &path("out"))?;
    assert_eq!(files, [0, 1, 2].map(|k| path("out").join(format!("00{k}.npy"))));
    let array = npyz::NpyFile::new(std::fs::File::open(&files[1])?)?;
    assert_eq!(array.shape(), [3, 32, 32]);
    let values: Vec<f32> = array.into_vec()?;
    assert!(values.iter().all(|value| (0.0..=1.0).contains(value)));
    let plain = dataset::write(&config, &path("simulated"), None, &path("plain"))?;
    let plain: Vec<f32> = npyz::NpyFile::new(std::fs::File::open(&plain[1])?)?.into_vec()?;
    assert!(plain.len() == values.len() && plain != values, "translated");
    let described: serde_json::Value = serde_json::from_slice(&std::fs::read(path("out/001.json"))?)?;
    assert_eq!(described["vehicles"].as_array().map(Vec::len), Some(3));
    assert!(
        described["vehicles"][0]["length_m"].as_f64().is_some_and(|length| (3.0..4.0).contains(&length)),
        "{described}"
    );

    let refused = |out: &str| {
        let written = dataset::write(&config, &path("simulated"), None, &path(out));
        written.map_or_else(|e| format!("{e:#}"), |_| String::new())
    };
    formats::write(&path("simulated/001.npy"), &scan(7, 0.5, [CAR, VEGETATION]))?;
    assert!(refused("twice").contains("another has the same name") && !path("twice").exists(), "{}", refused("twice"));
    std::fs::remove_file(path("simulated/001.ply"))?;
    assert!(refused("simulated").contains("is a scan itself"), "{}", refused("simulated"));
    std::fs::remove_file(path("simulated/001.npy"))?;

    config.grid.height_m = [-2.0, 2.0];
    let refused =
        detection(&config, &[path("simulated")], &question).map_or_else(|e| format!("{e:#}"), |_| String::new());
    assert!(refused.contains("its grid or projected_by is not the config's"), "{refused}");
    Ok(())
}
