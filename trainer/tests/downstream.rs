//! What labelled scans teach a network is told by real ones.

#[expect(dead_code, reason = "the toy's parts that translations need")]
mod toy;

use std::path::{Path, PathBuf};

use lidar::{RangeImage, Sensor, formats};
use toy::{COLUMNS, FAR_M, Fact, measured, walls};
use trainer::segmentation::SegmentationConfig;
use trainer::segmentation::downstream::{Question, downstream};

/// SemanticKITTI's learning map.
const BUILDING: u8 = 13;
const VEGETATION: u8 = 15;

/// A network for walls; `projected` is what is said of scans that were projected before.
fn config(root: &Path, projected: &str) -> Result<SegmentationConfig, Box<dyn std::error::Error>> {
    let path = root.join("config.toml");
    let text = format!(
        "summary = \"A toy\"\nlicence = \"MIT\"\nsensor = \"vlp16\"\ncolumns = {COLUMNS}\nsteps = 300\nbatch = 2\ncrop_columns = 32\n\
         learning_rate = 1e-2\n[network]\nchannels = [4, 4, 4, 4, 4]\n[labelled]\npath = \"none\"\nsource = \"made up\"\nlicence = \"MIT\"\n\
         held_out = 1\nleft_out = 0\n{projected}\n[streets]\nlearned = 1\nheld_out = 1\n"
    );
    std::fs::write(&path, text)?;
    Ok(SegmentationConfig::read(&path)?)
}

/// Writes scans whose near walls are of one class and whose far ones are of another.
fn write(folder: &Path, scans: impl Iterator<Item = RangeImage>, (near, far): (u8, u8)) -> Fact {
    std::fs::create_dir(folder)?;
    let sensor = Sensor::builtin("vlp16")?.with_columns(COLUMNS)?;
    for (k, mut scan) in scans.enumerate() {
        for i in 0..scan.range_m().len() {
            let range_m = scan.range_m()[i];
            if range_m > 0.0 {
                scan.set(i, range_m, 0.5, if range_m > FAR_M { far } else { near });
            }
        }
        formats::write(&folder.join(format!("{k}.ply")), &scan.to_cloud(&sensor))?;
    }
    Ok(())
}

/// Networks of these seeds, scored on these scans.
fn question(real: PathBuf, seeds: &[u64]) -> Question {
    Question { real, seeds: seeds.to_vec(), reflectance: true }
}

/// The cells of a row, from its scans on.
fn cells(table: &str, row: usize) -> Vec<&str> {
    table.lines().nth(row + 2).map_or_else(Vec::new, |line| line.split('|').skip(2).map(str::trim).collect())
}

#[test]
fn whoever_learned_from_scans_like_the_real_ones_knows_the_real_ones() -> Fact {
    let root = tempfile::tempdir()?;
    let path = |name: &str| root.path().join(name);
    write(&path("like"), (0..6).map(measured), (BUILDING, VEGETATION))?;
    write(&path("clean"), (0..6).map(walls), (BUILDING, VEGETATION))?;
    write(&path("unlike"), (0..4).map(measured), (VEGETATION, BUILDING))?;
    write(&path("real"), (100..103).map(measured), (BUILDING, VEGETATION))?;
    let folders = ["like", "clean", "unlike"].map(path);
    let table = downstream(&config(root.path(), "")?, &folders, &question(path("real"), &[1]))?;
    assert!(
        table.starts_with("| learned from | scans | pixel accuracy | mean IoU | building | vegetation |\n"),
        "{table}"
    );
    let [like, clean, unlike] = [0, 1, 2].map(|row| cells(&table, row));
    assert_eq!((like[0], unlike[0]), ("6", "4"), "{table}");
    // Clean scans have no holes, and teach nothing of them.
    let accuracy = |cells: &[&str]| cells[1].parse::<f64>();
    assert!(accuracy(&like)? > 0.9 && accuracy(&clean)? < 0.8 && accuracy(&unlike)? < 0.1, "{table}");
    assert!(table.contains("\n3 real scans; 300 steps"), "{table}");

    // Two seeds are a mean and an interval; and the same network comes of the same seed whatever else is learned.
    let both = downstream(&config(root.path(), "")?, &folders[..1], &question(path("real"), &[1, 2]))?;
    assert!(cells(&both, 0)[1].contains(" ± ") && !table.contains('±'), "{both}\n{table}");
    let again = downstream(&config(root.path(), "")?, &folders[..1], &question(path("real"), &[1]))?;
    assert_eq!(cells(&again, 0), like);
    Ok(())
}

/// The simulator's reflectance tells the class, the sensor's tells the other.
#[test]
fn reflectances_that_mislead_may_be_left_unseen() -> Fact {
    let root = tempfile::tempdir()?;
    let sensor = Sensor::builtin("vlp16")?.with_columns(COLUMNS)?;
    for (name, first, bright) in [("learned", 0, BUILDING), ("real", 100, VEGETATION)] {
        std::fs::create_dir(root.path().join(name))?;
        for k in 0..4 {
            let mut scan = measured(first + k);
            for i in 0..scan.range_m().len() {
                let range_m = scan.range_m()[i];
                if range_m > 0.0 {
                    let class = if range_m > FAR_M { VEGETATION } else { BUILDING };
                    scan.set(i, range_m, if class == bright { 1.0 } else { 0.0 }, class);
                }
            }
            formats::write(&root.path().join(name).join(format!("{k}.ply")), &scan.to_cloud(&sensor))?;
        }
    }
    let accuracy = |reflectance| -> Result<f64, Box<dyn std::error::Error>> {
        let question = Question { reflectance, ..question(root.path().join("real"), &[1]) };
        let table = downstream(&config(root.path(), "")?, &[root.path().join("learned")], &question)?;
        assert_eq!(table.contains("reflectances unseen"), !reflectance, "{table}");
        Ok(cells(&table, 0)[1].parse()?)
    };
    let (seen, unseen) = (accuracy(true)?, accuracy(false)?);
    assert!(seen < 0.7 && unseen > 0.9, "{seen} {unseen}");
    Ok(())
}

#[test]
fn scans_that_teach_nothing_are_refused_by_name() -> Fact {
    let root = tempfile::tempdir()?;
    let path = |name: &str| root.path().join(name);
    write(&path("real"), (100..102).map(measured), (BUILDING, VEGETATION))?;
    write(&path("unlabelled"), (0..2).map(walls), (0, 0))?;
    let config = config(root.path(), "projected_by = \"vlp16\"")?;
    let refusal = |learned: &str, real: &str| {
        downstream(&config, &[path(learned)], &question(path(real), &[1]))
            .map_or_else(|e| format!("{e:#}"), |_| String::new())
    };
    assert_eq!(refusal("real", "real"), "");
    assert!(
        refusal("unlabelled", "real").contains("unlabelled: none of the labels"),
        "{}",
        refusal("unlabelled", "real")
    );
    assert!(refusal("real", "unlabelled").contains("real scans' labels"));
    assert!(refusal("nowhere", "real").contains("nowhere"));
    std::fs::create_dir(path("bare"))?;
    std::fs::write(path("bare").join("7.bin"), [0; 16])?;
    assert!(refusal("bare", "real").contains("7.bin: it has no labels"), "{}", refusal("bare", "real"));
    Ok(())
}
