//! Translations' runs and tables, from folders of scans to networks, scores and pictures.

mod toy;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use burn::tensor::Device;
use lidar::{Sensor, formats};
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, cast};
use toy::{COLUMNS, Fact, config, measured, walls};
use trainer::generator::Answer;
use trainer::realness::Protocol;
use trainer::segmentation::weights::SegmentationCard;
use trainer::segmentation::{DarknetConfig, Segmentation};
use trainer::train::{Run, checkpoint};
use trainer::translation::table::{Table, evaluate};
use trainer::translation::training::best_network;
use trainer::translation::{TranslationConfig, train};
use trainer::{export, exported};

/// Scans of both domains in files, four of each part.
fn write_domains(root: &Path) -> Fact {
    let sensor = Sensor::builtin("vlp16")?.with_columns(COLUMNS)?;
    for (domain, real) in [("simulated", false), ("real", true)] {
        for (part, first) in [("train", 0), ("validate", 10), ("test", 20)] {
            let folder = root.join(domain).join(part);
            std::fs::create_dir_all(&folder)?;
            for seed in 0..4 {
                let image = if real { measured(100 + first + seed) } else { walls(first + seed) };
                formats::write(&folder.join(format!("{seed}.ply")), &image.to_cloud(&sensor))?;
            }
        }
    }
    Ok(())
}

fn run(root: &Path) -> Run {
    Run { out: root.join("run"), data: root.into(), resume: false, stop_after: None }
}

#[test]
fn a_run_leaves_a_network_its_scores_its_log_and_pictures() -> Fact {
    for method in ["cls2r", "unet"] {
        let root = tempfile::tempdir()?;
        write_domains(root.path())?;
        let config = config(method, "steps = 4\ncheckpoint_every = 2\nsamples_every = 2")?;
        let run = run(root.path());
        let scores = train(&config, &run)?.ok_or("the run did not end")?;
        assert_eq!((scores.simulated_scans, scores.real_scans, scores.model.len()), (4, 4, 3));
        // The simulation loses no ray, the real sensor six of ten far ones.
        assert!(scores.simulation[0].value > 0.2, "{scores:?}");
        let image = walls(1);
        let answer = Answer::new(&best_network(&config, &run.out)?, &image, &Device::flex());
        assert!(answer.keep.iter().all(|p| (0.0..=1.0).contains(p)) && answer.range_m.iter().all(|r| r.is_finite()));
        let log = std::fs::read_to_string(run.out.join("log.jsonl"))?;
        assert_eq!(log.lines().filter(|line| line.contains("validation")).count(), 2);
        let picture = image::open(run.out.join("samples/0000004.png"))?;
        assert!(picture.width() > 1000);
        let newest = checkpoint::newest(&run.out)?.ok_or("no checkpoint")?;
        assert!(newest.ends_with("checkpoint-0000004"));
    }
    Ok(())
}

/// [`export::export`] lets no file out that does not answer as Burn does.
#[test]
fn what_a_network_is_told_besides_is_part_of_its_file() -> Fact {
    let root = tempfile::tempdir()?;
    write_domains(root.path())?;
    let mut squashed = vec![];
    for (details, relief) in [(false, false), (true, true)] {
        let mut config = config("cls2r", "steps = 1\ncheckpoint_every = 1\nsamples_every = 0")?;
        (config.generator.details, config.generator.relief) = (details, relief);
        let run = Run { out: root.path().join(format!("run-{relief}")), ..run(root.path()) };
        train(&config, &run)?;
        let (onnx, card) = export::export(&run.out, root.path())?;
        assert_eq!(card.column_multiple, 4);
        squashed.push(onnx.windows(4).filter(|op| op == b"Tanh").count());
    }
    // The two slopes of the relief are, beside the correction of the range.
    assert!(squashed[1] > squashed[0], "{squashed:?}");
    Ok(())
}

/// [`export::export`] has also compared what it draws, noise by noise.
#[test]
fn reflectances_that_scatter_are_drawn_by_the_files_noise() -> Fact {
    let root = tempfile::tempdir()?;
    write_domains(root.path())?;
    let mut config = config("paired", "steps = 1\ncheckpoint_every = 1\nsamples_every = 0")?;
    config.generator.scatter = true;
    let run = run(root.path());
    train(&config, &run)?;
    let (onnx, card) = export::export(&run.out, root.path())?;
    assert_eq!((card.noise_channels, exported::card(&onnx)?.noise_channels), (1, 1));
    let image = walls(1);
    let answer = Answer::new(&best_network(&config, &run.out)?, &image, &Device::flex());
    let off = |seed| {
        let drawn = answer.drawn(&image, seed);
        let pairs = drawn.reflectance().iter().zip(&answer.reflectance).zip(drawn.range_m());
        let off: Vec<f32> = pairs.filter(|(_, range_m)| **range_m > 0.0).map(|((a, b), _)| (a - b).abs()).collect();
        off.iter().sum::<f32>() / off.len() as f32
    };
    let scatter = answer.scatter.as_ref().ok_or("no scatter")?;
    let expected = scatter.iter().sum::<f32>() / scatter.len() as f32;
    assert!((off(1) / expected - 1.0).abs() < 0.2 && off(1) != off(2), "{} {expected}", off(1));
    Ok(())
}

#[test]
fn damaged_weights_are_an_error_and_never_a_random_network() -> Fact {
    let root = tempfile::tempdir()?;
    write_domains(root.path())?;
    let config = config("cls2r", "steps = 1\ncheckpoint_every = 1")?;
    let run = run(root.path());
    train(&config, &run)?;
    let whole = std::fs::read(run.best())?;
    std::fs::write(run.best(), &whole[..whole.len() / 2])?;
    assert!(best_network(&config, &run.out).is_err());
    Ok(())
}

/// The binary in a process of its own, as a user starts it.
fn start(root: &Path, out: &str, arguments: &[&str]) -> std::io::Result<std::process::Child> {
    std::process::Command::new(env!("CARGO_BIN_EXE_realbeam-trainer"))
        .arg("train")
        .arg(root.join("config.toml"))
        .arg("--data")
        .arg(root)
        .arg("--out")
        .arg(root.join(out))
        .args(arguments)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
}

/// How far a student is from its teacher after one step and after 120: in probabilities to be reported, and in reflectance.
fn taught(seed: u64) -> Result<[[f32; 2]; 2], Box<dyn std::error::Error>> {
    let root = tempfile::tempdir()?;
    write_domains(root.path())?;
    let (image, device, seed) = (walls(7), Device::flex(), seed.to_string());
    let learn =
        |out: &str, config: &TranslationConfig, teacher: &[&str]| -> Result<Answer, Box<dyn std::error::Error>> {
            std::fs::write(root.path().join("config.toml"), config.to_toml()?)?;
            assert!(start(root.path(), out, &[&["--seed", &seed], teacher].concat())?.wait()?.success(), "{out}");
            Ok(Answer::new(&best_network(config, &root.path().join(out))?, &image, &device))
        };
    let schedule = |steps: usize| format!("steps = {steps}\ncheckpoint_every = {steps}\nsamples_every = {steps}");
    let teacher = learn("teacher", &config("cls2r", &schedule(40))?, &[])?;
    let run = root.path().join("teacher");
    let run = run.to_str().ok_or("a path that is no text")?;
    let error = |steps: usize| -> Result<[f32; 2], Box<dyn std::error::Error>> {
        let out = steps.to_string();
        let student = learn(&out, &config("distil", &schedule(steps))?, &["--teacher", run])?;
        assert!(root.path().join(&out).join(format!("samples/{steps:07}.png")).exists());
        let error = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32;
        Ok([error(&student.keep, &teacher.keep), error(&student.reflectance, &teacher.reflectance)])
    };
    Ok([error(1)?, error(120)?])
}

/// About one of eight networks so small begins with most of its units dead, and learns little: two of three starts have to learn. Each is a
/// process of its own, for the random numbers that weights begin with are a process's, whatever the seed: with them, other tests would decide.
#[test]
fn a_student_comes_to_answer_as_its_teacher_does() -> Fact {
    let starts = (1..=3).map(taught).collect::<Result<Vec<_>, _>>()?;
    let learned =
        starts.iter().filter(|[begun, ended]| ended[0] < 0.25 * begun[0] && ended[1] < 0.5 * begun[1]).count();
    assert!(learned >= 2, "keep and reflectance, after 1 step and after 120: {starts:?}");
    Ok(())
}

#[test]
fn a_student_has_a_teacher_and_its_licence() -> Fact {
    let root = tempfile::tempdir()?;
    write_domains(root.path())?;
    let run = |name: &str| Run { out: root.path().join(name), ..run(root.path()) };
    let taught = config("cls2r", "steps = 1\ncheckpoint_every = 1\nsamples_every = 0")?;
    train(&taught, &run("teacher"))?;
    let student = config("distil", "steps = 1\ncheckpoint_every = 1")?;
    let refusal = |config: &TranslationConfig| {
        train(config, &run("refused")).map_or_else(|e| format!("{e:#}"), |_| String::new())
    };
    assert!(refusal(&student).contains("name the run to learn from"));
    let freed = TranslationConfig { licence: "CC0-1.0".into(), ..student }.with_teacher(Some(run("teacher").out))?;
    assert!(refusal(&freed).contains("licence MIT"), "a student is its teacher's by licence");
    let unet = config("unet", "")?.with_teacher(Some(run("teacher").out));
    assert!(unet.is_err_and(|e| e.to_string().contains("a U-Net learns from no other run")));
    Ok(())
}

#[test]
fn whoever_has_a_teacher_and_a_game_begins_with_its_weights() -> Fact {
    let root = tempfile::tempdir()?;
    write_domains(root.path())?;
    let run = |name: &str| Run { out: root.path().join(name), ..run(root.path()) };
    let pretrained = config("paired", "steps = 3\ncheckpoint_every = 3\nsamples_every = 0")?;
    train(&pretrained, &run("pretrained"))?;
    let answer = |config: &TranslationConfig, name: &str| -> Result<Vec<f32>, Box<dyn std::error::Error>> {
        let answer = Answer::new(&best_network(config, &run(name).out)?, &walls(7), &Device::flex());
        Ok([answer.range_m, answer.reflectance, answer.keep].concat())
    };
    let expected = answer(&pretrained, "pretrained")?;
    for method in ["cls2r", "cyclegan", "gcgan", "paired"] {
        let mut config = config(method, "steps = 1\ncheckpoint_every = 1\nsamples_every = 0")?;
        // So small a step leaves the network as it was.
        config.schedule.learning_rate = 1e-12;
        config.generator.gain = 1.0;
        train(&config, &run(&format!("{method}-alone")))?;
        let begun = config.clone().with_teacher(Some(run("pretrained").out))?;
        train(&begun, &run(method))?;
        let error = |name: &str| -> Result<f32, Box<dyn std::error::Error>> {
            Ok(answer(&config, name)?.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max))
        };
        assert!(error(method)? < 1e-3, "{method}: {}", error(method)?);
        assert!(error(&format!("{method}-alone"))? > 0.1, "{method}");

        let mut wider = begun;
        wider.generator.width = 16;
        let refusal = train(&wider, &run("refused")).map_or_else(|e| format!("{e:#}"), |_| String::new());
        assert!(refusal.contains("takes the same network"), "{method}: {refusal}");
        std::fs::remove_dir_all(run("refused").out)?;
    }
    Ok(())
}

#[test]
fn runs_that_were_killed_again_and_again_end_in_the_same_bits() -> Fact {
    // CycleGAN has most to remember: four networks, their optimisers, two pools of earlier answers, the average.
    for (method, kills) in [("cyclegan", 3), ("cls2r", 1)] {
        let root = tempfile::tempdir()?;
        write_domains(root.path())?;
        let schedule = "steps = 12\ncheckpoint_every = 1\nsamples_every = 0\ndecay_every = 5";
        std::fs::write(root.path().join("config.toml"), config(method, schedule)?.to_toml()?)?;
        assert!(start(root.path(), "whole", &[])?.wait()?.success());

        let out = root.path().join("killed");
        for kill in 0..kills {
            let resume: &[&str] = if kill == 0 { &[] } else { &["--resume"] };
            let mut child = start(root.path(), "killed", resume)?;
            let begun = Instant::now();
            let newest = || if out.exists() { checkpoint::newest(&out) } else { Ok(None) };
            let before = newest()?;
            // After some further checkpoints, wherever the run then is: in a step, or in writing a checkpoint.
            while newest()? == before && child.try_wait()?.is_none() {
                assert!(begun.elapsed() < Duration::from_mins(2), "no checkpoint");
                std::thread::sleep(Duration::from_millis(1));
            }
            std::thread::sleep(Duration::from_millis(7 * kill));
            child.kill()?;
            child.wait()?;
        }
        // What a kill in the middle of writing leaves behind.
        let half = out.join(".checkpoint-half");
        std::fs::create_dir_all(&half)?;
        std::fs::write(half.join("generator.bpk"), b"half of")?;
        assert!(start(root.path(), "killed", &["--resume"])?.wait()?.success());
        assert!(!half.exists(), "what was half-written is swept away");

        let last = |run: &str| -> Result<_, Box<dyn std::error::Error>> {
            let newest = checkpoint::newest(&root.path().join(run))?.ok_or("no checkpoint")?;
            Ok(checkpoint::load(&newest)?)
        };
        let ((_, whole), (_, killed)) = (last("whole")?, last("killed")?);
        assert_eq!(whole, killed);
        let values = |run: &str| -> Result<Vec<f32>, Box<dyn std::error::Error>> {
            let config = config(method, schedule)?;
            let network = best_network(&config, &root.path().join(run))?;
            let answer = Answer::new(&network, &walls(7), &Device::flex());
            Ok([answer.range_m, answer.reflectance, answer.keep].concat())
        };
        assert!(values("whole")? == values("killed")?, "{method}: the networks differ");
        let log = |run: &str| std::fs::read_to_string(root.path().join(run).join("log.jsonl"));
        assert_eq!(log("whole")?, log("killed")?, "{method}: every step stands in the log once");
    }
    Ok(())
}

/// Config files of three rows of so many steps each, and the table's; the last row learns from the first.
fn write_table(root: &Path, steps: [usize; 3]) -> Result<PathBuf, Box<dyn std::error::Error>> {
    let methods = ["gcgan", "unet", "distil"];
    for (method, steps) in methods.into_iter().zip(steps) {
        let config = config(method, &format!("steps = {steps}\ncheckpoint_every = 1\nsamples_every = 0"))?;
        std::fs::write(root.join(method).with_extension("toml"), config.to_toml()?)?;
    }
    let row = |method| format!("[[row]]\nname = \"{method}\"\nconfig = \"{method}.toml\"\n");
    let path = root.join("table.toml");
    std::fs::write(&path, format!("seeds = [1, 2]\n{}teacher = \"gcgan\"\n", methods.map(row).concat()))?;
    Ok(path)
}

#[test]
fn a_table_trains_what_is_missing_and_nothing_twice() -> Fact {
    let root = tempfile::tempdir()?;
    write_domains(root.path())?;
    let (table, out) = (Table::read(&write_table(root.path(), [2, 2, 3])?)?, root.path().join("runs"));
    let text = table.run(root.path(), &out, None)?;
    // Heading, line, three metrics.
    assert_eq!(text.lines().take_while(|line| line.starts_with('|')).count(), 5, "{text}");
    for word in ["| unet |", " ± ", "2 steps of 5 whole turns", "distil learned from what gcgan answers, in 3 steps"] {
        assert!(text.contains(word), "{word}: {text}");
    }
    // The real scans themselves are no distance from themselves; filled, they have more rays than were reported.
    let (_, twins) = text.split_once("real itself").ok_or("no second part")?;
    let line = twins.lines().find(|line| line.contains("lost rays")).ok_or("no lost rays")?;
    let number = |column: usize| line.split('|').nth(column).unwrap_or_default().trim().parse::<f64>();
    assert!(number(2)? > 0.05 && number(6)? == 0.0, "{line}");
    assert!(twins.contains("| keep AUC | 0.5"), "{twins}");
    let student = TranslationConfig::read(&out.join("distil/seed-2/config.toml"))?;
    assert_eq!(student.teacher, Some(out.join("gcgan/seed-2")));

    // One run was interrupted before it was scored; then one was never begun.
    let seed = |row: &str, seed: usize| out.join(row).join(format!("seed-{seed}"));
    let untouched = || std::fs::metadata(seed("gcgan", 1).join("log.jsonl"))?.modified();
    let begun = untouched()?;
    std::fs::remove_file(seed("unet", 1).join("scores.json"))?;
    assert_eq!(table.run(root.path(), &out, None)?, text);
    std::fs::remove_dir_all(seed("gcgan", 2))?;
    table.run(root.path(), &out, None)?;
    assert!(seed("gcgan", 2).join("scores.json").exists());
    assert_eq!(untouched()?, begun);

    let path = write_table(root.path(), [2, 3, 3])?;
    assert!(Table::read(&path).is_err_and(|e| e.to_string().contains("budget")));
    write_table(root.path(), [2, 2, 3])?;
    std::fs::write(&path, std::fs::read_to_string(&path)?.replace("teacher = \"gcgan\"", "teacher = \"cls2r\""))?;
    assert!(Table::read(&path).is_err_and(|e| e.to_string().contains("no row above is cls2r")));
    Ok(())
}

#[test]
fn with_a_segmentation_network_a_table_tells_every_metric() -> Fact {
    let (root, sensor) = (tempfile::tempdir()?, Sensor::builtin("hdl32e")?.with_columns(128)?);
    for part in ["train", "validate", "test"] {
        for domain in ["simulated", "real"] {
            let folder = root.path().join(domain).join(part);
            std::fs::create_dir_all(&folder)?;
            for seed in 0..2 {
                let cast = cast(&street(seed, &StreetConfig::default()), &sensor, &Pose::default(), &Motion::default());
                formats::write(&folder.join(format!("{seed}.ply")), &cast.image.to_cloud(&sensor))?;
            }
        }
    }
    let config = config("unet", "steps = 1\ncheckpoint_every = 1\nsamples_every = 0")?.to_toml()?;
    let config = config.replace("vlp16", "hdl32e").replace("columns = 64", "columns = 128");
    std::fs::write(root.path().join("unet.toml"), config)?;
    let path = root.path().join("table.toml");
    std::fs::write(&path, "seeds = [1]\n[[row]]\nname = \"unet\"\nconfig = \"unet.toml\"\n")?;
    let size = DarknetConfig { channels: [8; 5] };
    let network = size.init(&Device::flex());
    let segmentation = Segmentation { network, card: SegmentationCard::new("random", "MIT", "", sensor, size) };
    let text = Table::read(&path)?.run(root.path(), &root.path().join("runs"), Some(&segmentation))?;
    // Both domains are the same streets: the simulation is no distance from real, and has lost nothing.
    let line = |name: &str| text.lines().find(|line| line.contains(name)).ok_or_else(|| format!("no {name} in {text}"));
    for name in ["Fréchet", "SWD", "voxels", "reflectance", "empty rays", "range RMSE"] {
        let value: f64 = line(name)?.split('|').nth(2).ok_or("no column")?.trim().parse()?;
        assert!(value.abs() < 1e-6, "{name} is {value}: {text}");
    }
    assert!(root.path().join("runs/answers.png").exists());

    let (run, config) =
        (root.path().join("runs/unet/seed-1"), TranslationConfig::read(&root.path().join("unet.toml"))?);
    let of = |protocol| evaluate(&config, &run, root.path(), (&segmentation, protocol));
    let (ours, authors) = (of(Protocol::Realbeam)?, of(Protocol::Cls2r)?);
    // A table of one run says of it what the run alone does.
    let column =
        |text: &str, i: usize| text.lines().filter_map(|l| Some(l.split('|').nth(i)?.trim().to_owned())).collect();
    let (in_table, alone): (Vec<String>, Vec<String>) =
        (column(&text, 3), column(&ours.replace("| toy |", "| unet |"), 3));
    assert_eq!(in_table, alone);
    for metric in ["SWD", "JSD", "MMD", "CD", "RMSE"] {
        assert!(authors.contains(&format!("| cls2r {metric}")), "{authors}");
    }
    Ok(())
}

#[test]
fn the_papers_rows_are_valid_configs_on_one_budget() -> Fact {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/translation");
    for name in
        ["unet", "baseline", "cyclegan", "gcgan", "contrastive", "cls2r", "fast", "distilled", "twins", "paired"]
    {
        let read = |folder: PathBuf| TranslationConfig::read(&folder.join(name).with_extension("toml"));
        let (paper, small) = (read(folder.clone())?, read(folder.join("small"))?);
        assert_eq!((paper.method, paper.ray_drop), (small.method, small.ray_drop), "{name}");
        assert_eq!(paper.generator.condition, small.generator.condition, "{name}");
        assert!(small.schedule.steps < paper.schedule.steps, "{name}");
    }
    for entry in std::fs::read_dir(folder.join("small"))? {
        let path = entry?.path();
        match path.file_stem().and_then(|stem| stem.to_str()) {
            // What others extend.
            Some("base") => {}
            Some(name) if name.starts_with("table") => drop(Table::read(&path)?),
            _ => drop(TranslationConfig::read(&path)?),
        }
    }
    Ok(())
}
