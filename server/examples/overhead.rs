//! What the service costs beyond the model's own run: a scan of 120,000 points as float32 × 4, asked for over HTTP again and again.
//!
//!     cargo run --release -p server --example overhead -- [MODELS] [MODEL] [REQUESTS]
//!
//! Without arguments it uses the tests' stand-in of 64 rings and 2048 columns, whose own run is nearly free. Prints the median time
//! of each stage, of the whole answer as the client sees it, and of the difference to the model's run.

use std::path::PathBuf;
use std::time::Instant;

use lidar::formats::{self, Format};
use lidar::{PointCloud, Sensor};
use server::{Config, WorkerOptions, serve};

const POINTS: usize = 120_000;

type Result<T = ()> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result {
    let mut arguments = std::env::args().skip(1);
    let tests = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/models");
    let models = arguments.next().map_or(tests, PathBuf::from);
    let default_model = arguments.next().unwrap_or_else(|| "hdl64e".into());
    let requests: usize = arguments.next().map_or(Ok(200), |n| n.parse())?;
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let server = serve(&Config {
        models,
        default_model,
        addr: "127.0.0.1:0".parse()?,
        workers: WorkerOptions { workers: 1, threads: threads.into(), queue: 4 },
        ..Config::default()
    })?;
    let body = formats::encode(Format::Kitti, &street()?)?;
    let agent = ureq::Agent::new_with_defaults();
    let url = format!("http://{}/v1/scan", server.addr());

    let (mut total_ms, mut beyond_ms) = (Vec::new(), Vec::new());
    let mut stages: Vec<(String, Vec<f64>)> = Vec::new();
    for request in 0..requests + 10 {
        let started = Instant::now();
        let mut answer = agent.post(&url).content_type("application/octet-stream").send(&body)?;
        let bytes = answer.body_mut().with_config().limit(1 << 30).read_to_vec()?;
        let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
        assert!(!bytes.is_empty());
        // The first requests warm up.
        if request < 10 {
            continue;
        }
        let timing = answer.headers().get("server-timing").ok_or("no server-timing")?.to_str()?;
        let mut infer_ms = 0.0;
        for (i, stage) in timing.split(", ").enumerate() {
            let (name, ms) = stage.split_once(";dur=").ok_or("no dur")?;
            let ms: f64 = ms.parse()?;
            if i == stages.len() {
                stages.push((name.into(), Vec::new()));
            }
            stages[i].1.push(ms);
            if name == "infer" {
                infer_ms = ms;
            }
        }
        total_ms.push(elapsed_ms);
        beyond_ms.push(elapsed_ms - infer_ms);
    }

    println!("{} points, {} bytes, {requests} requests, {threads} threads; medians (least) in ms", POINTS, body.len());
    let inside_ms: f64 = stages.iter().map(|(_, ms)| median(ms)).sum();
    for (name, ms) in &stages {
        print(name, ms);
    }
    print("whole answer", &total_ms);
    print("beyond the model's run", &beyond_ms);
    println!("{:<24} {:8.3}", "HTTP and copies", median(&total_ms) - inside_ms);
    server.stop()?;
    Ok(())
}

/// A scan as an HDL-64E makes it: ground below, walls around, a return on most rays.
fn street() -> Result<PointCloud> {
    let sensor = Sensor::builtin("hdl64e")?;
    let mut cloud = PointCloud::new(1.0);
    for i in 0..POINTS {
        let pixel = i * sensor.pixels() / POINTS;
        let (ring, column) = (pixel / sensor.columns(), pixel % sensor.columns());
        let direction = sensor.direction(ring, column);
        let ground_m = if direction[2] < 0.0 { -1.73 / direction[2] } else { f64::INFINITY };
        let wall_m = 10.0 + 8.0 * (column as f64 * 0.01).sin();
        let range_m = ground_m.min(wall_m);
        cloud.x.push((direction[0] * range_m) as f32);
        cloud.y.push((direction[1] * range_m) as f32);
        cloud.z.push((direction[2] * range_m) as f32);
        cloud.intensity.push((i % 100) as f32 / 100.0);
    }
    Ok(cloud)
}

fn print(name: &str, ms: &[f64]) {
    let least = ms.iter().copied().fold(f64::INFINITY, f64::min);
    println!("{name:<24} {:8.3} ({least:.3})", median(ms));
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}
