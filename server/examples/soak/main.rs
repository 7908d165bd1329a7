//! A service under a steady load of everything that it can be asked, for as long as one likes: does its memory grow?
//!
//!     cargo run --release -p server --example soak -- MODELS MODEL SECONDS [--leak BYTES]
//!
//! The service runs in a process of its own. Five seconds of load and a moment of silence take turns, and in the silence its memory is
//! read, so that no request under way is mistaken for growth. After a quarter of the time, which warms up, the growth is the slope of
//! Theil and Sen with its 95 % interval. The exit status is 1 if all of the interval lies above 1 MB an hour, or if anything was
//! answered in another way than it should be. What a short run cannot tell is said too: the interval shrinks with the time to the
//! power of about −3/2, and only a run whose interval ends below 1 MB an hour has shown that nothing more leaks.
//!
//! `--leak` has the hosting process lose so many bytes a request, to show that the gate closes. 86400 seconds are a day.

mod crowd;
#[path = "../shared/figures.rs"]
mod figures;
mod host;
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
const WARM_UP: f64 = 0.25;

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
    let mut samples = Vec::new();
    let mut requests = 0;
    while started.elapsed().as_secs_f64() < seconds {
        let asked = crowd.ask_for(ROUND);
        requests += asked;
        host.lose(asked)?;
        crowd.wait_for_silence()?;
        let (at_s, bytes) = (started.elapsed().as_secs_f64(), figures::resident_bytes(host.process())?);
        if at_s >= seconds * WARM_UP {
            samples.push((at_s / 3600.0, bytes));
        }
        if samples.len() == 1 || reported.elapsed() >= REPORT {
            println!("{:6.0} s: {requests} requests, {:.2} MB", at_s, bytes / 1e6);
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
    let Some(slope) = Slope::of(&samples) else {
        return Err("too few samples; let it run for at least three minutes".into());
    };
    let Slope { low, middle, high } = slope;
    let mb = |bytes: f64| bytes / 1e6;
    println!(
        "{} samples after the warm-up: {:+.2} MB an hour, 95 % interval {:+.2} to {:+.2}",
        samples.len(),
        mb(middle),
        mb(low),
        mb(high)
    );
    let grows = low > TOO_MUCH;
    println!(
        "{}",
        if grows {
            "it grows by more than 1 MB an hour"
        } else if high < TOO_MUCH {
            "it grows by less than 1 MB an hour, if at all"
        } else {
            "no growth is shown, nor that it is less than 1 MB an hour: that takes longer"
        }
    );
    Ok(if grows || !unexpected.is_empty() { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}
