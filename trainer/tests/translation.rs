//! Translations between domains whose difference is known: the one that is real loses most far rays.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use burn::tensor::{Device, Tensor, s};
use lidar::{RangeImage, Sensor, formats};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, cast};
use trainer::generator::Answer;
use trainer::network::resnet::IMAGE_CHANNELS;
use trainer::realness::Protocol;
use trainer::segmentation::weights::SegmentationCard;
use trainer::segmentation::{DarknetConfig, Segmentation};
use trainer::train::{Run, checkpoint};
use trainer::translation::method::{Setting, Step, approach};
use trainer::translation::sampler::scans;
use trainer::translation::table::{Table, evaluate};
use trainer::translation::training::best_network;
use trainer::translation::twins::Disguise;
use trainer::translation::{Domain, Sampler, TranslationConfig, train};

type Fact = Result<(), Box<dyn std::error::Error>>;

const COLUMNS: usize = 64;
/// Beyond it, the real sensor of these tests loses rays.
const FAR_M: f32 = 20.0;
/// After so many steps, methods are judged.
const STEPS: usize = 160;

/// Walls at 4 to 12 m and at 30 to 80 m, eight columns wide each.
fn walls(seed: u64) -> RangeImage {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut image = RangeImage::empty(16, COLUMNS);
    for block in 0..COLUMNS / 8 {
        let range_m = if rng.random_bool(0.5) { rng.random_range(4.0..12.0) } else { rng.random_range(30.0..80.0) };
        for i in (0..16).flat_map(|ring| (0..8).map(move |column| ring * COLUMNS + 8 * block + column)) {
            image.set(i, range_m + rng.random_range(-0.1..0.1), 0.5, 13);
        }
    }
    image
}

/// What the real sensor of these tests sees of walls: it loses six of ten far rays, and no near one.
fn measured(seed: u64) -> RangeImage {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut image = walls(seed);
    for i in 0..16 * COLUMNS {
        if image.range_m()[i] > FAR_M && rng.random_bool(0.6) {
            image.remove(i);
        }
    }
    image
}

/// A config of a tiny network; `schedule` is what its table says beside the size of batches.
fn config(method: &str, schedule: &str) -> Result<TranslationConfig, Box<dyn std::error::Error>> {
    let data = |domain: &str, part: &str| {
        format!(
            "[[{domain}.{part}]]\npath = \"{domain}/{part}\"\ncolumns = {COLUMNS}\nsource = \"made up\"\nlicence = \"MIT\"\n"
        )
    };
    let mut text = format!(
        "name = \"toy\"\nsummary = \"A toy\"\nlicence = \"MIT\"\nsensor = \"vlp16\"\ncolumns = {COLUMNS}\nmethod = \"{method}\"\nseed = 3\n\
         [generator]\nwidth = 8\nblocks = 2\noutput = \"correction\"\n[discriminator]\nwidth = 8\nhalvings = 2\n\
         [losses]\npatches = 64\ncontrast = 0.03\ncontrast_identity = 0.03\ncycle = 1.0\ngeometry = 2.0\nidentity = 0.5\n[unet]\nchannels = [16, 16, 16, 16]\n\
         [schedule]\nbatch = 5\ncrop_columns = {COLUMNS}\nlearning_rate = 1e-3\naverage = 0.9\n{schedule}\n"
    );
    for domain in ["simulated", "real"] {
        for part in ["train", "validate", "test"] {
            text += &data(domain, part);
        }
    }
    Ok(TranslationConfig::from_table(toml::from_str(&text)?)?)
}

/// How probable it is, on average, that rays nearer and farther than [`FAR_M`] are reported.
fn keeps(answer: &[f32], image: &RangeImage) -> (f32, f32) {
    let mean = |far: bool| {
        let rays: Vec<f32> =
            image.range_m().iter().zip(answer).filter(|(r, _)| (**r > FAR_M) == far).map(|(_, keep)| *keep).collect();
        rays.iter().sum::<f32>() / rays.len() as f32
    };
    (mean(false), mean(true))
}

/// The probabilities after so many steps, from random weights of a start's own, twins weighing so much.
fn learned(method: &str, twins: f64, start: u64) -> Result<(f32, f32), Box<dyn std::error::Error>> {
    /// The device's random numbers are everybody's.
    static STARTS: Mutex<()> = Mutex::new(());
    let mut config = config(method, "")?;
    config.losses.twins = twins;
    let device = Device::flex().autodiff();
    let setting = Setting {
        generator: config.training_generator()?,
        reporting: config.reporting()?,
        losses: config.losses,
        image_numbers: IMAGE_CHANNELS * 16 * COLUMNS,
    };
    let mut learner = {
        let _alone = STARTS.lock().unwrap_or_else(PoisonError::into_inner);
        device.seed(start);
        approach(&config, setting, &device)?.ok_or("it plays against nobody")?
    };
    let domain = |images: Vec<RangeImage>| Domain { images, datasets: vec![] };
    let sampler = Sampler {
        simulated: domain((0..20).map(walls).collect()),
        real: domain((100..120).map(measured).collect()),
        seed: 1,
        batch: config.schedule.batch,
        crop_columns: COLUMNS,
        augmentation: config.augmentation,
        disguise: (twins > 0.0).then(Disguise::default),
    };
    let coding = setting.reporting.coding;
    for number in 0..STEPS {
        let pair = sampler.pair(number, &device);
        let [simulated, real] = [pair.simulated, pair.real].map(|scan| coding.view(&scan));
        let twins = sampler.twins(number, coding, &device);
        learner.step(&Step { simulated, real, twins, seed: 1, number, rate: config.schedule.rate(number) });
    }
    let image = walls(1000);
    let view = coding.view(&scans(std::slice::from_ref(&image), &device));
    let logit: Tensor<4> = learner.generator().forward(view.image, &view.condition).keep_logit;
    let keep: Vec<f32> = burn::tensor::activation::sigmoid(logit).slice(s![0..1]).into_data().iter::<f32>().collect();
    Ok(keeps(&keep, &image))
}

/// The sensor keeps all near rays and four of ten far ones; to begin with, about half of all. So few steps of a game between two networks
/// may end elsewhere: about one start of four does, so a method has five.
fn learns_which_rays_are_lost(method: &str) -> Fact {
    let mut kept = vec![];
    for start in 1..=5 {
        let (near, far) = learned(method, 0.0, start)?;
        if near > 0.8 && far < 0.7 {
            return Ok(());
        }
        kept.push((near, far));
    }
    Err(format!("near and far rays are kept with {kept:?}").into())
}

#[test]
fn cls2r_learns_which_rays_are_lost() -> Fact {
    learns_which_rays_are_lost("cls2r")
}

/// What no game between two networks promises: the probability itself, from any start.
#[test]
fn twins_say_how_many_rays_are_lost() -> Fact {
    for start in 1..=2 {
        let (near, far) = learned("cls2r", 1.0, start)?;
        assert!(
            near > 0.9 && (0.25..0.6).contains(&far),
            "start {start}: near and far rays are kept with {near}, {far}"
        );
    }
    Ok(())
}

#[test]
fn cycle_gan_learns_which_rays_are_lost() -> Fact {
    learns_which_rays_are_lost("cyclegan")
}

#[test]
fn gc_gan_learns_which_rays_are_lost() -> Fact {
    learns_which_rays_are_lost("gcgan")
}

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

#[test]
fn a_student_comes_to_answer_as_its_teacher_does() -> Fact {
    let root = tempfile::tempdir()?;
    write_domains(root.path())?;
    let run = |name: &str| Run { out: root.path().join(name), ..run(root.path()) };
    let taught = config("cls2r", "steps = 40\ncheckpoint_every = 40\nsamples_every = 0")?;
    train(&taught, &run("teacher"))?;
    let student = |steps: usize| -> Result<TranslationConfig, Box<dyn std::error::Error>> {
        let schedule = format!("steps = {steps}\ncheckpoint_every = {steps}\nsamples_every = {steps}");
        Ok(config("distil", &schedule)?.with_teacher(Some(run("teacher").out))?)
    };
    let (image, device) = (walls(7), Device::flex());
    let teacher = Answer::new(&best_network(&taught, &run("teacher").out)?, &image, &device);
    let error = |name: &str, steps: usize| -> Result<[f32; 2], Box<dyn std::error::Error>> {
        let config = student(steps)?;
        train(&config, &run(name))?;
        let answer = Answer::new(&best_network(&config, &run(name).out)?, &image, &device);
        let error = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32;
        Ok([error(&answer.keep, &teacher.keep), error(&answer.reflectance, &teacher.reflectance)])
    };
    let (begun, ended) = (error("begun", 1)?, error("ended", 120)?);
    assert!(ended[0] < 0.25 * begun[0] && ended[1] < 0.5 * begun[1], "keep and reflectance: {begun:?}, {ended:?}");
    assert!(run("ended").out.join("samples/0000120.png").exists());

    let refusal = |config: &TranslationConfig| {
        train(config, &run("refused")).map_or_else(|e| format!("{e:#}"), |_| String::new())
    };
    assert!(refusal(&TranslationConfig { teacher: None, ..student(1)? }).contains("name the run to learn from"));
    let freed = TranslationConfig { licence: "CC0-1.0".into(), ..student(1)? };
    assert!(refusal(&freed).contains("licence MIT"), "a student is its teacher's by licence");
    assert!(
        taught.with_teacher(Some(run("teacher").out)).is_err_and(|e| e.to_string().contains("only the method distil"))
    );
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
    for name in ["unet", "baseline", "cyclegan", "gcgan", "contrastive", "cls2r", "fast", "distilled", "twins"] {
        let read = |folder: PathBuf| TranslationConfig::read(&folder.join(name).with_extension("toml"));
        let (paper, small) = (read(folder.clone())?, read(folder.join("small"))?);
        assert_eq!((paper.method, paper.ray_drop), (small.method, small.ray_drop), "{name}");
        assert_eq!(paper.generator.condition, small.generator.condition, "{name}");
        assert!(small.schedule.steps < paper.schedule.steps, "{name}");
    }
    TranslationConfig::read(&folder.join("small/hdl64e-cls2r.toml"))?;
    for name in ["table", "table-carla"] {
        Table::read(&folder.join("small").join(name).with_extension("toml"))?;
    }
    Ok(())
}
