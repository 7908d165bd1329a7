//! The process that hosts the service, and how it is told to lose memory.

use std::io::{BufRead, BufReader, Write, stdin};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use peak_alloc::PeakAlloc;
use server::{Config, ConnectionLimits, WorkerOptions, serve};

use crate::Result;

/// First argument of the process that hosts.
pub(crate) const WORD: &str = "host";

/// Counts what Rust code allocates; ONNX Runtime has allocators of its own.
#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// The hosting process; killed when dropped.
pub(crate) struct Host {
    child: Child,
    orders: ChildStdin,
    words: BufReader<ChildStdout>,
    pub(crate) addr: String,
}

impl Host {
    /// Starts this program again as the host of a service.
    pub(crate) fn start(models: &str, model: &str, leak: usize) -> Result<Self> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args([WORD, models, model, &leak.to_string()]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn()?;
        let (orders, said) = (child.stdin.take().ok_or("no stdin")?, child.stdout.take().ok_or("no stdout")?);
        let mut host = Self { child, orders, words: BufReader::new(said), addr: String::new() };
        host.addr = host.word()?;
        Ok(host)
    }

    /// What it says next.
    fn word(&mut self) -> Result<String> {
        let mut word = String::new();
        self.words.read_line(&mut word)?;
        word.truncate(word.trim_end().len());
        if word.is_empty() { Err("the service has ended".into()) } else { Ok(word) }
    }

    /// Its process.
    pub(crate) fn process(&self) -> u32 {
        self.child.id()
    }

    /// Has it lose what it is to lose for so many requests; the bytes that it has allocated then.
    pub(crate) fn lose(&mut self, requests: usize) -> Result<f64> {
        writeln!(self.orders, "{requests}")?;
        Ok(self.word()?.parse()?)
    }

    /// Ends it in good order.
    pub(crate) fn stop(mut self) -> Result {
        self.orders.write_all(b"end\n")?;
        let status = self.child.wait()?;
        if status.success() { Ok(()) } else { Err(format!("the service ended with {status}").into()) }
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Hosts a service and says its address. For each request that a line of stdin counts it loses `leak` bytes; then it says how many it has.
pub(crate) fn run(models: PathBuf, model: &str, leak: usize) -> Result {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let server = serve(&Config {
        models,
        default_model: model.into(),
        addr: "127.0.0.1:0".parse()?,
        // Few places, so that some are turned away.
        workers: WorkerOptions { workers: 1, threads: threads.into(), batch: 1, queue: 2 },
        connections: ConnectionLimits { max: 32, ..ConnectionLimits::default() },
        ..Config::default()
    })?;
    println!("{}", server.addr());
    for line in stdin().lines() {
        let Ok(requests) = line?.parse::<usize>() else { break };
        for _ in 0..if leak > 0 { requests } else { 0 } {
            std::mem::forget(vec![1_u8; leak]);
        }
        println!("{}", MEMORY.current_usage());
    }
    server.stop()?;
    Ok(())
}
