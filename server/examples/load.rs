//! More scans than the service can take: arrivals at a multiple of its capacity, whatever becomes of them, as a crowd of clients would.
//!
//!     cargo run --release -p server --example load -- [MODELS] [MODEL] [TIMES CAPACITY] [SECONDS] [QUEUE] [WORKERS] [THREADS]
//!
//! Prints how long answers took before and under the load, how long refusals took, and what memory the process had (client included).

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use lidar::PointCloud;
use lidar::formats::{self, Format};
use server::{Config, WorkerOptions, serve};

/// Few points, so that the clients do not need what the service should have: the model's own run is that of its whole grid.
const POINTS: usize = 4000;
const CLIENTS: usize = 96;

type Result<T = ()> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |i: usize, default: &str| arguments.get(i).cloned().unwrap_or_else(|| default.into());
    let (times, seconds): (f64, f64) = (argument(2, "10").parse()?, argument(3, "60").parse()?);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let server = serve(&Config {
        models: PathBuf::from(argument(0, "models")),
        default_model: argument(1, "hdl64e"),
        addr: "127.0.0.1:0".parse()?,
        workers: WorkerOptions {
            workers: argument(5, "1").parse()?,
            threads: argument(6, &threads.to_string()).parse::<usize>()?.into(),
            queue: argument(4, "1").parse()?,
        },
        ..Config::default()
    })?;
    let url = format!("http://{}/v1/scan", server.addr());
    let body = formats::encode(Format::Kitti, &street())?;
    let ask = |agent: &ureq::Agent| -> Result<(u16, f64)> {
        let started = Instant::now();
        let mut answer = agent.post(&url).content_type("application/octet-stream").send(&body)?;
        answer.body_mut().read_to_vec()?;
        Ok((answer.status().as_u16(), started.elapsed().as_secs_f64() * 1e3))
    };

    let agent = agent();
    for _ in 0..10 {
        ask(&agent)?;
    }
    let mut alone = (0..60).map(|_| Ok(ask(&agent)?.1)).collect::<Result<Vec<f64>>>()?;
    let capacity = 1e3 * alone.len() as f64 / alone.iter().sum::<f64>();
    let (every, before_mib) = (Duration::from_secs_f64(1.0 / (times * capacity)), resident_mib()?);

    let (started, next) = (Instant::now(), AtomicUsize::new(0));
    let (answers, largest_mib) = (Mutex::new(BTreeMap::<u16, Vec<f64>>::new()), Mutex::new(before_mib));
    std::thread::scope(|scope| {
        for _ in 0..CLIENTS {
            scope.spawn(|| {
                let agent = self::agent();
                loop {
                    // Each arrival has its time, however long those before it take.
                    let at = every * next.fetch_add(1, Ordering::Relaxed) as u32;
                    if at.as_secs_f64() > seconds {
                        return;
                    }
                    std::thread::sleep((started + at).saturating_duration_since(Instant::now()));
                    // Status 0: no answer at all.
                    let (status, ms) = ask(&agent).unwrap_or((0, 0.0));
                    if let Ok(mut answers) = answers.lock() {
                        answers.entry(status).or_default().push(ms);
                    }
                }
            });
        }
        scope.spawn(|| {
            while started.elapsed().as_secs_f64() < seconds {
                if let (Ok(now), Ok(mut largest)) = (resident_mib(), largest_mib.lock()) {
                    *largest = now.max(*largest);
                }
                std::thread::sleep(Duration::from_millis(100));
            }
        });
    });

    let (half, most) = quantiles(&mut alone);
    println!("alone: {capacity:.1} scans/s; p50 {half:.1} ms, p99 {most:.1} ms");
    println!("{times} times that for {seconds} s:");
    for (status, mut ms) in answers.into_inner()? {
        let n = ms.len();
        let (half, most) = quantiles(&mut ms);
        println!("  {status}: {n}, {:.1} a second; p50 {half:.1} ms, p99 {most:.1} ms", n as f64 / seconds);
    }
    println!(
        "memory: {before_mib:.0} MiB before, {:.0} at most, {:.0} after",
        largest_mib.into_inner()?,
        resident_mib()?
    );
    Ok(())
}

fn agent() -> ureq::Agent {
    ureq::Agent::config_builder().http_status_as_error(false).build().into()
}

/// Median and 99th percentile.
fn quantiles(values: &mut [f64]) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[(share * (values.len() - 1) as f64).round() as usize];
    (at(0.5), at(0.99))
}

/// Memory of this process.
fn resident_mib() -> Result<f64> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).ok_or("no VmRSS")?;
    Ok(line.trim().trim_end_matches("kB").trim().parse::<f64>()? / 1024.0)
}

/// Points around the sensor, 10 to 60 m away.
fn street() -> PointCloud {
    let mut cloud = PointCloud::new(1.0);
    for i in 0..POINTS {
        let (turn, up) = (i as f32 * 0.37, (i % 64) as f32 / 64.0 * -0.4);
        let range_m = 10.0 + (i * 7 % 50) as f32;
        cloud.x.push(range_m * turn.cos() * up.cos());
        cloud.y.push(range_m * turn.sin() * up.cos());
        cloud.z.push(range_m * up.sin());
        cloud.intensity.push(0.3);
    }
    cloud
}
