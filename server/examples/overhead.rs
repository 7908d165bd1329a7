//! What the service costs beyond the model's own run: one scan as float32 × 4, asked for over HTTP again and again, in turns with a bare
//! run of the same model on the same range image, and with bytes that only go to a socket and come back.
//!
//!     cargo run --release -p server --example overhead -- [MODELS] [MODEL] [REQUESTS] [COLUMNS] [POINTS]
//!
//! Without arguments it uses the tests' stand-in of 64 rings and 2048 columns, whose own run is nearly free, and 120,000 points. With
//! COLUMNS the model serves a grid of so many columns, as if its card said so. Prints the median (and least) time of each stage, of the
//! whole answer as the client sees it, of the bare run, and the difference of the two.

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
use server::{Config, MAX_MODEL_BYTES, Model, Repository, Server, WorkerOptions, serve};

/// Bytes that an answer's head surely fits into.
const HEAD_BYTES: usize = 64 << 10;

/// Times that the service is started, and a bare session beside it: where a session's weights come to lie makes a run of 40 ms up to 1 ms
/// faster or slower.
const STARTS: usize = 5;

/// Rounds after a start that warm up.
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
    let config = Config {
        models: folder.path().into(),
        default_model: name,
        addr: "127.0.0.1:0".parse()?,
        workers: WorkerOptions { workers: 1, threads: threads.into(), batch: 1, queue: 4 },
        ..Config::default()
    };
    let cloud = street::street(&model.card.sensor, points);
    let body = formats::encode(Format::Kitti, &cloud)?;
    let mut figures = Figures::default();
    for _ in 0..STARTS {
        let server = serve(&config)?;
        let (service, bare) = (Service::connect(&server)?, Bare::new(&model, &cloud, threads)?);
        figures.take(service, bare, &body, requests.div_ceil(STARTS))?;
        server.stop()?;
    }
    let sensor = &model.card.sensor;
    println!(
        "{points} points, {} bytes, {} rings × {} columns, {} rounds, {threads} threads; medians (least) in ms",
        body.len(),
        sensor.rings().len(),
        sensor.columns(),
        figures.whole_ms.len()
    );
    figures.print();
    Ok(())
}

/// What is measured, round by round.
#[derive(Default)]
#[allow(clippy::struct_field_names, reason = "each is in milliseconds")]
struct Figures {
    stages_ms: Vec<(String, Vec<f64>)>,
    whole_ms: Vec<f64>,
    bare_ms: Vec<f64>,
    loopback_ms: Vec<f64>,
}

impl Figures {
    /// Takes as many rounds. The service's answer and the bare run each come after the same bytes on a socket, and find the same caches.
    fn take(&mut self, mut service: Service, mut bare: Bare, body: &[u8], rounds: usize) -> Result {
        let mut loopback = Loopback::start(body.len(), service.ask(body)?.bytes)?;
        for round in 0..rounds + WARM_UP {
            let before_ms = loopback.pass(body)?;
            let answer = service.ask(body)?;
            loopback.pass(body)?;
            let bare_ms = bare.run()?;
            if round < WARM_UP {
                continue;
            }
            self.loopback_ms.push(before_ms);
            self.whole_ms.push(answer.elapsed_ms);
            self.bare_ms.push(bare_ms);
            for (i, (stage, ms)) in answer.stages_ms.into_iter().enumerate() {
                if i == self.stages_ms.len() {
                    self.stages_ms.push((stage, Vec::new()));
                }
                self.stages_ms[i].1.push(ms);
            }
        }
        Ok(())
    }

    fn print(&self) {
        for (name, ms) in &self.stages_ms {
            print(name, ms);
        }
        let inside_ms: f64 = self.stages_ms.iter().map(|(_, ms)| median(ms)).sum();
        let (whole_ms, bare_ms) = (median(&self.whole_ms), median(&self.bare_ms));
        println!("{:<28} {:8.3}", "HTTP and copies", whole_ms - inside_ms);
        print("whole answer", &self.whole_ms);
        print("bare run", &self.bare_ms);
        let beyond_ms = whole_ms - bare_ms;
        println!("{:<28} {beyond_ms:8.3}, {:.1} % of the run", "difference", 100.0 * beyond_ms / bare_ms);
        print("the bytes there and back", &self.loopback_ms);
    }
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

/// The service, as a client sees it who does no more than [`Loopback`] does: its own work would be counted as the service's.
struct Service {
    stream: TcpStream,
    /// The latest answer's bytes; their memory is used again.
    answer: Vec<u8>,
}

impl Service {
    fn connect(server: &Server) -> Result<Self> {
        let stream = TcpStream::connect(server.addr().tcp().ok_or("no TCP address")?)?;
        stream.set_nodelay(true)?;
        Ok(Self { stream, answer: vec![0; HEAD_BYTES] })
    }

    fn ask(&mut self, body: &[u8]) -> Result<Answer> {
        let started = Instant::now();
        let head = format!("POST /v1/scan HTTP/1.1\r\nhost: x\r\ncontent-length: {}\r\n\r\n", body.len());
        self.stream.write_all(head.as_bytes())?;
        self.stream.write_all(body)?;
        let mut came = 0;
        let (head, head_bytes) = loop {
            match self.stream.read(&mut self.answer[came..])? {
                0 => return Err("the answer has no end of its head".into()),
                read => came += read,
            }
            if let Some(end) = self.answer[..came].windows(4).position(|bytes| bytes == b"\r\n\r\n") {
                break (String::from_utf8(self.answer[..end].to_vec())?, end + 4);
            }
        };
        let field = |name: &str| {
            let fields = head.lines().filter_map(|line| line.split_once(": "));
            fields.filter(|field| field.0 == name).map(|field| field.1).next().ok_or(format!("{head}: no {name}"))
        };
        let bytes: usize = field("content-length")?.parse()?;
        self.answer.resize(head_bytes + bytes, 0);
        self.stream.read_exact(&mut self.answer[came..])?;
        let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
        assert!(head.starts_with("HTTP/1.1 200 ") && bytes > 0, "{head}");
        let stage = |stage: &str| {
            let (name, ms) = stage.split_once(";dur=").ok_or("no dur")?;
            Ok((name.into(), ms.parse()?))
        };
        let stages_ms = field("server-timing")?.split(", ").map(stage).collect::<Result<_>>()?;
        Ok(Answer { elapsed_ms, bytes, stages_ms })
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
    fn pass(&mut self, body: &[u8]) -> Result<f64> {
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
