//! More scans than the service can take: arrivals at a multiple of its capacity, whatever becomes of them, as a crowd of clients would.
//!
//!     cargo run --release -p server --example load -- [MODELS] [MODEL] [TIMES CAPACITY] [SECONDS] [QUEUE] [WORKERS] [THREADS] [NICE] [BATCH]
//!
//! Prints how long answers took before and under the load, how long refusals took, what processor time they cost by thread, and what
//! memory the service had. The clients are a process of their own, as nice as NICE (0 to 19) says: 19 is the nearest that one machine
//! comes to clients that have another.

#[path = "shared/figures.rs"]
mod figures;
#[path = "shared/memory.rs"]
mod memory;
#[path = "shared/processor.rs"]
mod processor;
#[path = "shared/street.rs"]
mod street;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::{Child, Command};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use figures::{median, quantile};
use lidar::Sensor;
use lidar::formats::{self, Format};
use memory::resident_bytes;
use server::{Config, WorkerOptions, serve};

/// Few points, so that the clients do not need what the service should have: the model's own run is that of its whole grid.
const POINTS: usize = 4000;
const CLIENTS: usize = 96;

/// First argument of the process that asks.
const CROWD: &str = "crowd";

type Result<T = ()> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |i: usize, default: &str| arguments.get(i).cloned().unwrap_or_else(|| default.into());
    if argument(0, "") == CROWD {
        return crowd(&argument(1, ""), argument(2, "").parse()?, argument(3, "").parse()?);
    }
    let (times, seconds) = (argument(2, "10"), argument(3, "60"));
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let server = serve(&Config {
        models: PathBuf::from(argument(0, "models")),
        default_model: argument(1, "hdl64e"),
        addr: "127.0.0.1:0".parse()?,
        workers: WorkerOptions {
            workers: argument(5, "1").parse()?,
            threads: argument(6, &threads.to_string()).parse::<usize>()?.into(),
            batch: argument(8, "1").parse()?,
            queue: argument(4, "1").parse()?,
        },
        ..Config::default()
    })?;
    let this = std::process::id();
    let (before_mib, cpu_before) = (resident_bytes(this)? / f64::from(1 << 20), processor::taken_by_thread_s()?);
    let mut command = Command::new("nice");
    command.arg("-n").arg(argument(7, "0")).arg(std::env::current_exe()?).arg(CROWD);
    let mut crowd = command.arg(format!("http://{}/v1/scan", server.addr())).arg(times).arg(seconds).spawn()?;
    let largest_mib = watch(&mut crowd)?.max(before_mib);
    println!("processor time of the service's threads, by name:");
    for (name, seconds) in processor::taken_by_thread_s()? {
        println!("  {name}: {:.1} s", seconds - cpu_before.get(&name).copied().unwrap_or_default());
    }
    println!("memory: {before_mib:.0} MiB before, {largest_mib:.0} at most");
    server.stop()?;
    Ok(())
}

/// Waits until the crowd has gone; the largest memory of this process meanwhile, in MiB.
fn watch(crowd: &mut Child) -> Result<f64> {
    let mut largest: f64 = 0.0;
    loop {
        largest = largest.max(resident_bytes(std::process::id())? / f64::from(1 << 20));
        match crowd.try_wait()? {
            Some(status) if status.success() => return Ok(largest),
            Some(status) => return Err(format!("the clients ended with {status}").into()),
            None => std::thread::sleep(Duration::from_secs(1)),
        }
    }
}

/// The clients.
fn crowd(url: &str, times: f64, seconds: f64) -> Result {
    let body = formats::encode(Format::Kitti, &street::street(&Sensor::builtin("hdl64e")?, POINTS))?;
    let ask = |agent: &ureq::Agent| -> Result<(u16, f64)> {
        let started = Instant::now();
        let mut answer = agent.post(url).content_type("application/octet-stream").send(&body)?;
        answer.body_mut().read_to_vec()?;
        Ok((answer.status().as_u16(), started.elapsed().as_secs_f64() * 1e3))
    };
    let agent = agent();
    for _ in 0..10 {
        ask(&agent)?;
    }
    let alone = (0..100).map(|_| Ok(ask(&agent)?.1)).collect::<Result<Vec<f64>>>()?;
    let capacity = 1e3 * alone.len() as f64 / alone.iter().sum::<f64>();
    let every = Duration::from_secs_f64(1.0 / (times * capacity));

    let (started, next) = (Instant::now(), AtomicUsize::new(0));
    let answers = Mutex::new(BTreeMap::<u16, Vec<f64>>::new());
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
    });
    println!("alone: {capacity:.1} scans/s; p50 {:.1} ms, p99 {:.1} ms", median(&alone), quantile(&alone, 0.99));
    println!("{times} times that for {seconds} s:");
    for (status, ms) in answers.into_inner()? {
        let (half, most) = (median(&ms), quantile(&ms, 0.99));
        let rate = ms.len() as f64 / seconds;
        println!("  {status}: {}, {rate:.1} a second; p50 {half:.1} ms, p99 {most:.1} ms", ms.len());
    }
    println!("processor time of the clients: {:.1} s", processor::taken_s().unwrap_or_default());
    Ok(())
}

fn agent() -> ureq::Agent {
    ureq::Agent::config_builder().http_status_as_error(false).build().into()
}
