//! A service under a steady load of everything that it can be asked, for as long as one likes: does its memory grow?
//!
//!     cargo run --release -p server --example soak -- MODELS MODEL SECONDS [--leak BYTES]
//!
//! The service runs in a process of its own. Five seconds of load and a moment of silence take turns, and in the silence two things are
//! read, so that no request under way is mistaken for growth: the memory that the process has of the machine's, and the bytes that its
//! own code has allocated and not freed. The second hardly scatters, so that ten minutes tell what it does in an hour; the first counts
//! ONNX Runtime's memory too, and what the allocator keeps, and comes to rest only after minutes. Half of the time warms up, and of the
//! rest the growth is the slope of Theil and Sen with its 95 % interval.
//!
//! The exit status is 1 if an interval lies above 1 MB an hour as a whole, or if anything was answered in another way than it should be.
//! An interval that reaches from below to above shows neither growth nor its absence, and that is said: it takes a longer run.
//!
//! `--leak` has the hosting process lose so many bytes a request, to show that the gate closes. 86400 seconds are a day.

mod crowd;
#[path = "../shared/figures.rs"]
mod figures;
mod host;
#[path = "../shared/memory.rs"]
mod memory;
mod slope;
#[path = "../shared/street.rs"]
mod street;

use std::process::ExitCode;
use std::time::{Duration, Instant};

use crowd::Crowd;
use host::Host;
use slope::Slope;

type Result<T = ()> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Time of one round of load.
const ROUND: Duration = Duration::from_secs(5);

/// Share of the time that warms up.
const WARM_UP: f64 = 0.5;

/// Growth that is too much, in bytes an hour.
const TOO_MUCH: f64 = 1e6;

/// How often the memory is printed.
const REPORT: Duration = Duration::from_mins(1);

fn main() -> Result<ExitCode> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        [host::WORD, models, model, leak] => {
            host::run(models.into(), model, leak.parse()?)?;
            Ok(ExitCode::SUCCESS)
        }
        [models, model, seconds] => soak(models, model, seconds.parse()?, 0),
        [models, model, seconds, "--leak", leak] => soak(models, model, seconds.parse()?, leak.parse()?),
        _ => Err("expected MODELS MODEL SECONDS [--leak BYTES]".into()),
    }
}

fn soak(models: &str, model: &str, seconds: f64, leak: usize) -> Result<ExitCode> {
    let mut host = Host::start(models, model, leak)?;
    let crowd = Crowd::new(&host.addr, model)?;
    let (started, mut reported) = (Instant::now(), Instant::now());
    let (mut resident, mut allocated, mut requests) = (Vec::new(), Vec::new(), 0);
    while started.elapsed().as_secs_f64() < seconds {
        let asked = crowd.ask_for(ROUND);
        requests += asked;
        crowd.wait_for_silence()?;
        let own = host.lose(asked)?;
        let (at_s, all) = (started.elapsed().as_secs_f64(), memory::resident_bytes(host.process())?);
        if at_s >= seconds * WARM_UP {
            resident.push((at_s / 3600.0, all));
            allocated.push((at_s / 3600.0, own));
        }
        if requests == asked || reported.elapsed() >= REPORT {
            println!("{at_s:6.0} s: {requests} requests, {:.2} MB, of them {:.3} allocated", all / 1e6, own / 1e6);
            reported = Instant::now();
        }
    }
    host.stop()?;
    for (what, status, number) in crowd.answers()? {
        println!("{number:8} {status} {what}");
    }
    let unexpected = crowd.unexpected()?;
    if let Some(example) = unexpected.first() {
        println!("{} answers were not as they should be, the first one: {example}", unexpected.len());
    }
    let mut grows = false;
    for (what, samples) in [("the process", &resident), ("its own allocations", &allocated)] {
        let slope = Slope::of(samples).ok_or("too few samples; let it run for at least five minutes")?;
        let Slope { low, middle, high } = slope;
        let verdict = match () {
            () if low > TOO_MUCH => "more than 1 MB an hour",
            () if high < TOO_MUCH => "less than 1 MB an hour, if any",
            () => "whether it is less than 1 MB an hour, a longer run can tell",
        };
        let [low, middle, high] = [low, middle, high].map(|bytes| bytes / 1e6);
        println!("{what}: growth {middle:+.3} MB an hour, 95 % interval {low:+.3} to {high:+.3}: {verdict}");
        grows |= slope.low > TOO_MUCH;
    }
    Ok(if grows || !unexpected.is_empty() { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}
