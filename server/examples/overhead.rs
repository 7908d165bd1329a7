//! What the service costs beyond the model's own run: one scan as float32 × 4, asked for over HTTP again and again, in turns with a bare
//! run of the same model on the same range image, and with bytes that only go to a socket and come back.
//!
//!     cargo run --release -p server --example overhead -- [MODELS] [MODEL] [REQUESTS] [COLUMNS] [POINTS]
//!
//! Without arguments it uses the tests' stand-in of 64 rings and 2048 columns, whose own run is nearly free, and 120,000 points. With
//! COLUMNS the model serves a grid of so many columns, as if its card said so. Prints the median (and least) time of each stage, of the
//! whole answer as the client sees it, of the bare run, and of their difference.

#[path = "shared/figures.rs"]
mod figures;
#[path = "shared/street.rs"]
mod street;

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::time::Instant;

use figures::median;
use lidar::formats::{self, Format};
use lidar::ray_drop::uniform;
use lidar::{PointCloud, Projection, Projector};
use ort::value::TensorRef;
use prost::Message;
use proto::card::{Card, METADATA_KEY, tensor};
use server::{Config, MAX_MODEL_BYTES, Model, Repository, WorkerOptions, serve};

/// Rounds that warm up.
const WARM_UP: usize = 10;

type Result<T = ()> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result {
    let mut arguments = std::env::args().skip(1);
    let tests = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/models");
    let models = arguments.next().map_or(tests, PathBuf::from);
    let name = arguments.next().unwrap_or_else(|| "hdl64e".into());
    let requests: usize = arguments.next().map_or(Ok(200), |n| n.parse())?;
    let columns: Option<usize> = arguments.next().map(|n| n.parse()).transpose()?;
    let points: usize = arguments.next().map_or(Ok(120_000), |n| n.parse())?;
    let threads = std::thread::available_parallelism().map_or(1, usize::from);

    let folder = tempfile::tempdir()?;
    let file = with_columns(&Repository::new(models), &name, columns, folder.path())?;
    let model = Model::read(&file, MAX_MODEL_BYTES)?;
    let server = serve(&Config {
        models: folder.path().into(),
        default_model: name,
        addr: "127.0.0.1:0".parse()?,
        workers: WorkerOptions { workers: 1, threads: threads.into(), batch: 1, queue: 4 },
        ..Config::default()
    })?;
    let cloud = street::street(&model.card.sensor, points);
    let mut service = Service {
        url: format!("http://{}/v1/scan", server.addr()),
        agent: ureq::Agent::new_with_defaults(),
        answer: Vec::new(),
    };
    let (mut bare, body) = (Bare::new(&model, &cloud, threads)?, formats::encode(Format::Kitti, &cloud)?);

    let mut loopback = None;
    let (mut whole_ms, mut bare_ms, mut loopback_ms) = (Vec::new(), Vec::new(), Vec::new());
    let mut stages: Vec<(String, Vec<f64>)> = Vec::new();
    for round in 0..requests + WARM_UP {
        let answer = service.ask(&body)?;
        let run_ms = bare.run()?;
        let loopback = match &mut loopback {
            Some(loopback) => loopback,
            none => none.insert(Loopback::start(body.len(), answer.bytes)?),
        };
        let there_and_back_ms = loopback.pass(&body, answer.bytes)?;
        if round < WARM_UP {
            continue;
        }
        whole_ms.push(answer.elapsed_ms);
        bare_ms.push(run_ms);
        loopback_ms.push(there_and_back_ms);
        for (i, (stage, ms)) in answer.stages_ms.into_iter().enumerate() {
            if i == stages.len() {
                stages.push((stage, Vec::new()));
            }
            stages[i].1.push(ms);
        }
    }
    let sensor = &model.card.sensor;
    println!(
        "{points} points, {} bytes, {} rings × {} columns, {requests} rounds, {threads} threads; medians (least) in ms",
        body.len(),
        sensor.rings().len(),
        sensor.columns()
    );
    let inside_ms: f64 = stages.iter().map(|(_, ms)| median(ms)).sum();
    for (name, ms) in &stages {
        print(name, ms);
    }
    println!("{:<28} {:8.3}", "HTTP and copies", median(&whole_ms) - inside_ms);
    print("whole answer", &whole_ms);
    print("bare run", &bare_ms);
    let beyond_ms = median(&whole_ms) - median(&bare_ms);
    println!("{:<28} {beyond_ms:8.3}, {:.1} % of the run", "difference", 100.0 * beyond_ms / median(&bare_ms));
    print("the bytes there and back", &loopback_ms);
    server.stop()?;
    Ok(())
}

/// Copies a model's newest version into a folder of models, as if its card said so many columns. Returns the file.
fn with_columns(models: &Repository, name: &str, columns: Option<usize>, folder: &Path) -> Result<PathBuf> {
    /// The part of an ONNX file that holds its metadata.
    #[derive(Message)]
    struct Metadata {
        #[prost(message, repeated, tag = "14")]
        properties: Vec<Property>,
    }
    #[derive(Message)]
    struct Property {
        #[prost(string, tag = "1")]
        key: String,
        #[prost(string, tag = "2")]
        value: String,
    }
    let model = models.read(name, None)?;
    let file = models.root().join(name).join(model.version.unwrap_or_default().to_string()).join("model.onnx");
    let mut bytes = fs::read(file)?;
    if let Some(columns) = columns {
        let card = Card { sensor: model.card.sensor.with_columns(columns)?, ..model.card };
        let property = Property { key: METADATA_KEY.into(), value: serde_json::to_string(&card)? };
        // Messages one after the other are one message, and of two cards the first one counts.
        bytes = [Metadata { properties: vec![property] }.encode_to_vec(), bytes].concat();
    }
    let version = folder.join(name).join("1");
    fs::create_dir_all(&version)?;
    fs::write(version.join("model.onnx"), bytes)?;
    Ok(version.join("model.onnx"))
}

/// What a client sees of an answer.
struct Answer {
    elapsed_ms: f64,
    bytes: usize,
    stages_ms: Vec<(String, f64)>,
}

/// The service, as a client sees it.
struct Service {
    url: String,
    agent: ureq::Agent,
    /// The latest answer; its memory is used again.
    answer: Vec<u8>,
}

impl Service {
    fn ask(&mut self, body: &[u8]) -> Result<Answer> {
        let started = Instant::now();
        let mut answer = self.agent.post(&self.url).content_type("application/octet-stream").send(body)?;
        self.answer.clear();
        answer.body_mut().as_reader().read_to_end(&mut self.answer)?;
        let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
        assert!(!self.answer.is_empty());
        let timing = answer.headers().get("server-timing").ok_or("no server-timing")?.to_str()?;
        let stage = |stage: &str| {
            let (name, ms) = stage.split_once(";dur=").ok_or("no dur")?;
            Ok((name.into(), ms.parse()?))
        };
        Ok(Answer {
            elapsed_ms,
            bytes: self.answer.len(),
            stages_ms: timing.split(", ").map(stage).collect::<Result<_>>()?,
        })
    }
}

/// A session of ONNX Runtime, and nothing else.
struct Bare {
    session: ort::session::Session,
    grid: [usize; 2],
    scan: Vec<f32>,
    noise: Vec<f32>,
}

impl Bare {
    fn new(model: &Model, cloud: &PointCloud, threads: usize) -> Result<Self> {
        let sensor = &model.card.sensor;
        let mut projection = Projection::default();
        Projector::new(sensor).project_counted_into(cloud, None, &mut projection)?;
        let mut scan = vec![0.0; tensor::SCAN_CHANNELS * sensor.pixels()];
        projection.image.write_tensor(&mut scan);
        let mut noise = vec![0.0; model.card.noise_channels * sensor.pixels()];
        for (channel, block) in (1..).zip(noise.chunks_mut(sensor.pixels())) {
            uniform(0, channel, sensor.columns(), block);
        }
        Ok(Self { session: model.session(threads)?, grid: [sensor.rings().len(), sensor.columns()], scan, noise })
    }

    /// Time in ms.
    fn run(&mut self) -> Result<f64> {
        let [rings, columns] = self.grid;
        let shape = |block: &[f32]| [1, block.len() / (rings * columns), rings, columns];
        let started = Instant::now();
        let scan = TensorRef::from_array_view((shape(&self.scan), &*self.scan))?;
        let outputs = if self.noise.is_empty() {
            self.session.run(ort::inputs![tensor::SCAN => scan])?
        } else {
            let noise = TensorRef::from_array_view((shape(&self.noise), &*self.noise))?;
            self.session.run(ort::inputs![tensor::SCAN => scan, tensor::NOISE => noise])?
        };
        let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
        drop(outputs);
        Ok(elapsed_ms)
    }
}

/// A connection whose other end takes the bytes of a scan and gives those of an answer.
struct Loopback {
    stream: TcpStream,
    answer: Vec<u8>,
}

impl Loopback {
    fn start(asked: usize, answered: usize) -> Result<Self> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        let stream = TcpStream::connect(listener.local_addr()?)?;
        let (mut other, _) = listener.accept()?;
        std::thread::spawn(move || {
            let (mut scan, answer) = (vec![0; asked], vec![1; answered]);
            while other.read_exact(&mut scan).and_then(|()| other.write_all(&answer)).is_ok() {}
        });
        Ok(Self { stream, answer: vec![0; answered] })
    }

    /// Time in ms.
    fn pass(&mut self, body: &[u8], answered: usize) -> Result<f64> {
        assert_eq!(answered, self.answer.len(), "one seed gives one answer");
        let started = Instant::now();
        self.stream.write_all(body)?;
        self.stream.read_exact(&mut self.answer)?;
        Ok(started.elapsed().as_secs_f64() * 1e3)
    }
}

fn print(name: &str, ms: &[f64]) {
    let least = ms.iter().copied().fold(f64::INFINITY, f64::min);
    println!("{name:<28} {:8.3} ({least:.3})", median(ms));
}
