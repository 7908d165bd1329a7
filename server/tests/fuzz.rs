//! Everything that reads a stranger's bytes, given files that are nearly right: nothing panics, and nothing takes much more memory than
//! the file has bytes.
//!
//! Each reader in a process of its own, as many at a time as there are cores. It gets a fixed number of mutations, or as many as fit into
//! `REALBEAM_FUZZ_S` seconds, from the seed `REALBEAM_FUZZ_SEED`:
//!
//!     REALBEAM_FUZZ_S=60 cargo test --release --locked -p server --test fuzz -- --nocapture

use std::any::Any;
use std::fs;
use std::hint::black_box;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use lidar::PointCloud;
use lidar::cloud::{Column, Values};
use lidar::formats::{self, Format, Limits};
use peak_alloc::PeakAlloc;
use proto::card::{Card, METADATA_KEY};
use proto::open_inference::InferRequest;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use server::onnx_file::OnnxFile;

type Result<T = ()> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Counts what is allocated, in this whole process: a reader's has nothing else in it.
#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Names the reader of a process.
const READER: &str = "REALBEAM_FUZZ_READER";

/// Mutations of each reader's files.
const ROUNDS: u64 = 15_000;

/// Points of a scan, few beside what a crafted count asks for.
const LIMITS: Limits =
    Limits { max_points: 1000, max_unpacked_bytes: 192 << 10, carla_tags: lidar::label::CarlaTags::Since0914 };

/// Bytes that a reader may have at a time, for an input of so many.
fn most_memory(input: usize) -> usize {
    (16 << 20) + 8 * input
}

/// Whether the bytes are taken.
type Read = Box<dyn Fn(&[u8]) -> bool>;

/// A reader, with files that it takes.
struct Reader {
    name: String,
    seeds: Vec<Vec<u8>>,
    read: Read,
}

#[test]
fn no_mutated_file_makes_a_reader_panic_or_take_more_memory_than_is_its_due() -> Result {
    let names: Vec<String> = readers()?.into_iter().map(|reader| reader.name).collect();
    let program = std::env::current_exe()?;
    let next = AtomicUsize::new(0);
    let work = || {
        let mut faults = Vec::new();
        while let Some(name) = names.get(next.fetch_add(1, Ordering::Relaxed)) {
            let mut child = Command::new(&program);
            let child = child.args(["--exact", "--ignored", "--nocapture", "one_reader"]).env(READER, name);
            match child.output() {
                Ok(child) if child.status.success() => print!("{}", said(&child.stdout)),
                Ok(child) => faults.push(format!("{}{}", said(&child.stdout), String::from_utf8_lossy(&child.stderr))),
                Err(error) => faults.push(format!("{name}: {error}")),
            }
        }
        faults
    };
    let faults: Vec<String> = thread::scope(|scope| {
        let workers: Vec<_> = (0..thread::available_parallelism()?.get()).map(|_| scope.spawn(work)).collect();
        let faults = workers.into_iter().map(|worker| worker.join().map_err(|_| "a worker panicked"));
        Ok::<_, Box<dyn std::error::Error>>(faults.collect::<std::result::Result<Vec<_>, _>>()?.concat())
    })?;
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    Ok(())
}

/// What a reader's process says of it.
fn said(stdout: &[u8]) -> String {
    let lines = String::from_utf8_lossy(stdout);
    lines.split_inclusive('\n').filter(|line| line.contains(" mutations ")).collect()
}

#[test]
#[ignore = "run by the test above, once for each reader"]
fn one_reader() -> Result {
    let Ok(name) = std::env::var(READER) else { return Ok(()) };
    let time = std::env::var("REALBEAM_FUZZ_S").ok().map(|seconds| seconds.parse()).transpose()?;
    let seed: u64 = std::env::var("REALBEAM_FUZZ_SEED").map_or(Ok(0), |seed| seed.parse())?;
    let readers = readers()?;
    let place = readers.iter().position(|reader| reader.name == name).ok_or("no reader of this name")?;
    let reader = &readers[place];
    assert!(reader.seeds.iter().all(|seed| (reader.read)(seed)), "a seed of {name} is not taken as it is");
    assert!(attempt(&bad_reader(|| drop(black_box(vec![1_u8; 17 << 20]))), &[]).is_err(), "memory is seen");
    let (started, mut rounds, mut taken) = (Instant::now(), 0, 0);
    // Panics that a reader catches itself are its own affair.
    let hook = take_hook();
    set_hook(Box::new(|_| ()));
    assert!(attempt(&bad_reader(|| panic!()), &[]).is_err(), "a panic is seen");
    let mut fault = None;
    let is_over = |round| time.map_or(round == ROUNDS, |time| started.elapsed() >= Duration::from_secs(time));
    while fault.is_none() && !is_over(rounds) {
        let bytes = Random::new(seed, rounds, place).mutated(&reader.seeds);
        match attempt(reader, &bytes) {
            Ok(is_taken) => taken += u64::from(is_taken),
            Err(problem) => fault = Some((bytes, problem)),
        }
        rounds += 1;
    }
    set_hook(hook);
    println!("{name}: {rounds} mutations in {:.1?}, {taken} of them are taken", started.elapsed());
    let Some((bytes, problem)) = fault else {
        assert!(taken > 0 && taken < rounds, "mutations are neither harmless nor hopeless");
        return Ok(());
    };
    let file = std::env::temp_dir().join(format!("realbeam-fuzz.{name}"));
    fs::write(&file, bytes)?;
    Err(format!("{name}: {problem}; the file is {}", file.display()).into())
}

/// Whether the bytes are taken, or what is wrong with the reader.
fn attempt(reader: &Reader, bytes: &[u8]) -> std::result::Result<bool, String> {
    MEMORY.reset_peak_usage();
    let before = MEMORY.current_usage();
    let read = catch_unwind(AssertUnwindSafe(|| (reader.read)(bytes)));
    let memory = MEMORY.peak_usage().saturating_sub(before);
    let is_taken = read.map_err(|panic| format!("panicked: {}", words(&*panic)))?;
    if memory > most_memory(bytes.len()) {
        return Err(format!("took {memory} bytes for an input of {}", bytes.len()));
    }
    Ok(is_taken)
}

/// A reader that does something else.
fn bad_reader(act: fn()) -> Reader {
    let read = move |_: &[u8]| {
        act();
        true
    };
    Reader { name: String::new(), seeds: Vec::new(), read: Box::new(read) }
}

fn words(panic: &(dyn Any + Send)) -> &str {
    panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref().copied()).unwrap_or("without a word")
}

fn readers() -> Result<Vec<Reader>> {
    let mut readers = Vec::new();
    for format in Format::ALL {
        let read = move |bytes: &[u8]| formats::decode(format, bytes, &LIMITS).is_ok();
        readers.push(Reader { name: format.name().into(), seeds: seeds(format)?, read: Box::new(read) });
    }
    let labels = vec![formats::encode_labels(&[40, 10, 0, 1 << 16])];
    let read = |bytes: &[u8]| formats::decode_labels(bytes, 4).is_ok();
    readers.push(Reader { name: "labels".into(), seeds: labels, read: Box::new(read) });

    let json = br#"{"id":"7","parameters":{"seed":3,"binary_data_output":true},"inputs":[
        {"name":"POINTS","shape":[2,4],"datatype":"FP32","data":[[1,2.5,-3e1,0.25],[1,2,3,0.5]]},
        {"name":"scan","shape":[1,3,1,1],"datatype":"FP32","parameters":{"binary_data_size":12}}],
        "outputs":[{"name":"POINTS","parameters":{"binary_data":false}},{"name":"keep"}]}"#;
    // The number that the header gives, then the body.
    let request = [&(json.len() as u16).to_le_bytes()[..], json, &[0; 12]].concat();
    let read = |bytes: &[u8]| {
        let Some((length, body)) = bytes.split_first_chunk::<2>() else { return false };
        InferRequest::parse(body, Some(u16::from_le_bytes(*length).into())).is_ok()
    };
    readers.push(Reader { name: "infer".into(), seeds: vec![request], read: Box::new(read) });
    let read = |bytes: &[u8]| InferRequest::parse(bytes, None).is_ok();
    let json = br#"{"inputs":[{"name":"POINTS","shape":[1,4],"datatype":"FP32","data":[1,2,3,0.5]}]}"#.to_vec();
    readers.push(Reader { name: "infer-json".into(), seeds: vec![json], read: Box::new(read) });

    let models = ["passthrough/2", "ghosts/1", "hdl64e/1"].map(model);
    let models = models.into_iter().collect::<std::io::Result<Vec<_>>>()?;
    let mut cards = Vec::new();
    for model in &models {
        let metadata = OnnxFile::parse(model)?.metadata;
        cards.extend(metadata.into_iter().filter(|(key, _)| key == METADATA_KEY).map(|(_, card)| card.into_bytes()));
    }
    let read = |bytes: &[u8]| OnnxFile::parse(bytes).is_ok();
    readers.push(Reader { name: "onnx".into(), seeds: models, read: Box::new(read) });
    let read = |bytes: &[u8]| str::from_utf8(bytes).is_ok_and(|text| Card::from_json(text).is_ok());
    readers.push(Reader { name: "card".into(), seeds: cards, read: Box::new(read) });
    Ok(readers)
}

fn model(name: &str) -> std::io::Result<Vec<u8>> {
    fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/models").join(name).join("model.onnx"))
}

/// Small files of a format, in several of its forms.
fn seeds(format: Format) -> Result<Vec<Vec<u8>>> {
    let bare = PointCloud { ring: None, label: None, time_s: None, return_number: None, extra: vec![], ..cloud() };
    let mut seeds = vec![formats::encode(format, &cloud())?, formats::encode(format, &bare)?];
    match format {
        Format::Ply => {
            let head = "element face 1\nproperty list uchar int vertex_indices\nelement vertex 2\nproperty float x\n\
                        property double y\nproperty short z\nproperty uchar intensity\nend_header\n";
            seeds.push(format!("ply\nformat ascii 1.0\n{head}3 0 1 2\n1 2 3 4\n5 6 7 8\n").into_bytes());
            let big = format!("ply\nformat binary_big_endian 1.0\n{head}");
            seeds.push([big.as_bytes(), &[1, 0, 0, 0, 0], &[0; 30]].concat());
        }
        Format::Pcd => {
            let head =
                "VERSION .7\nFIELDS x y z _ n\nSIZE 4 4 8 1 2\nTYPE F F F U I\nCOUNT 1 1 1 3 2\nWIDTH 2\nHEIGHT 1\n";
            seeds.push(format!("{head}DATA ascii\n1 2 3 0 0 0 4 5\n1 nan 3 0 0 0 4 5\n").into_bytes());
            let packed = [10, 0, 0, 0, 46, 0, 0, 0, 3, 1, 2, 3, 4, 224, 32, 3, 0, 7];
            seeds.push([format!("{head}DATA binary_compressed\n").as_bytes(), &packed].concat());
        }
        _ => {}
    }
    Ok(seeds)
}

fn cloud() -> PointCloud {
    let ramp = |step: f32| (0..40).map(|i| i as f32 * step).collect::<Vec<_>>();
    PointCloud {
        x: ramp(0.5),
        y: ramp(-0.25),
        z: ramp(0.01),
        intensity: ramp(1.0),
        full_scale: 255.0,
        ring: Some((0..40).collect()),
        label: Some(vec![40; 40]),
        time_s: Some((0..40).map(|i| f64::from(i) * 1e-6).collect()),
        return_number: Some(vec![1; 40]),
        extra: vec![Column { name: "echo".into(), values: Values::I16(vec![-3; 40]) }],
        ros: None,
    }
}

/// What chance decides.
struct Random(ChaCha8Rng);

/// Numbers that break arithmetic, as they are written.
const NUMBERS: [&str; 9] =
    ["0", "-1", "65535", "4294967295", "4611686018427387904", "18446744073709551616", "1e999", "nan", "1e-320"];

impl Random {
    /// The same for a seed, a round and the place of a reader, whatever came before.
    fn new(seed: u64, round: u64, place: usize) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream((round << 8) | place as u64);
        Self(rng)
    }

    /// A number below `end`, 0 where there is none.
    fn below(&mut self, end: usize) -> usize {
        self.0.random_range(0..end.max(1))
    }

    /// One of the files, changed in one to four places.
    fn mutated(&mut self, seeds: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = seeds[self.below(seeds.len())].clone();
        for _ in 0..=self.below(4) {
            let other = &seeds[self.below(seeds.len())];
            self.mutate(&mut bytes, other);
        }
        bytes
    }

    fn mutate(&mut self, bytes: &mut Vec<u8>, other: &[u8]) {
        let at = self.below(bytes.len());
        let piece = at..(at + self.below(64)).min(bytes.len());
        match self.below(8) {
            0 => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << self.below(8)),
            1 => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte = self.0.random()),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(piece)),
            // A piece again, up to a thousand times.
            4 => {
                let again = bytes[piece].repeat(1 + self.below(10).pow(3));
                bytes.splice(at..at, again);
            }
            // A piece of another file of the kind.
            5 => {
                let from = self.below(other.len());
                let to = (from + self.below(256)).min(other.len());
                bytes.splice(piece, other[from..to].iter().copied());
            }
            // A length, of any width and either order.
            6 => {
                let number = [u64::MAX, 0, 1 << 62, 1 << 40, 0x8000_0000, 0x7fff_ffff, 0xffff, 1][self.below(8)];
                let number =
                    if self.below(2) == 0 { number.to_le_bytes() } else { number.rotate_right(32).to_be_bytes() };
                let width = [1, 2, 4, 8][self.below(4)];
                bytes.iter_mut().skip(at).zip(&number[..width]).for_each(|(byte, new)| *byte = *new);
            }
            // A number that is written out.
            _ => {
                let is_digit = |i: &usize| bytes.get(*i).is_some_and(u8::is_ascii_digit);
                if let Some(start) = (at..bytes.len()).find(is_digit) {
                    let end = (start..bytes.len()).find(|i| !is_digit(i)).unwrap_or(bytes.len());
                    bytes.splice(start..end, NUMBERS[self.below(NUMBERS.len())].bytes());
                }
            }
        }
    }
}
