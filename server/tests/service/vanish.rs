//! Clients that vanish in the middle of a request, many at a time: nothing that they took is missing afterwards.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio::task::JoinSet;

use crate::support::{Result, Service, bin, config, wait_until};

/// How far a client gets before it is gone.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Part {
    HalfAHead,
    HalfABody,
    WholeBody,
    WholeBodyAndTheAnswerBegun,
}

impl Part {
    const ALL: [Self; 4] = [Self::HalfAHead, Self::HalfABody, Self::WholeBody, Self::WholeBodyAndTheAnswerBegun];
}

/// A client: what it sends, and whether it goes with a reset instead of an end.
#[derive(Clone, Copy, Debug)]
struct Vanishing {
    part: Part,
    resets: bool,
}

impl Vanishing {
    /// Sends its part. Whoever is in the middle of it stays until told to go; the others go at once.
    async fn ask(self, addr: SocketAddr, body: Arc<Vec<u8>>, mut go: watch::Receiver<()>) -> std::io::Result<()> {
        let mut stream = TcpStream::connect(addr).await?;
        if self.resets {
            stream.set_zero_linger()?;
        }
        // The stand-in whose run takes longest, so that scans wait when their clients have gone.
        let query = if self.part == Part::HalfABody { "" } else { "?model=hdl64e" };
        let head = format!("POST /v1/scan{query} HTTP/1.1\r\nhost: x\r\ncontent-length: {}\r\n\r\n", body.len());
        match self.part {
            Part::HalfAHead => stream.write_all(&head.as_bytes()[..head.len() / 2]).await?,
            Part::HalfABody => stream.write_all(&[head.as_bytes(), &body[..body.len() / 2]].concat()).await?,
            Part::WholeBody | Part::WholeBodyAndTheAnswerBegun => {
                stream.write_all(&[head.as_bytes(), &body].concat()).await?;
            }
        }
        match self.part {
            // Once told, or once the one who tells has gone.
            Part::HalfAHead | Part::HalfABody => drop(go.changed().await),
            Part::WholeBody => {}
            Part::WholeBodyAndTheAnswerBegun => assert!(stream.read(&mut [0; 10]).await? > 0),
        }
        Ok(())
    }
}

impl Service {
    /// The sum of a gauge over its labels.
    fn gauge(&self, name: &str) -> Result<usize> {
        let text = String::from_utf8(self.get("/metrics")?.success()?)?;
        let is_of = |series: &&str| series.strip_prefix(name).is_some_and(|rest| rest.starts_with([' ', '{']));
        let values = text.lines().filter(is_of).filter_map(|series| series.rsplit(' ').next());
        Ok(values.map(str::parse::<usize>).sum::<std::result::Result<_, _>>()?)
    }
}

/// 50 clients, or as many as `REALBEAM_CLIENTS` says; then as many again, who find every place free.
#[test]
fn clients_that_vanish_in_the_middle_of_a_request_leave_every_permit_behind() -> Result {
    let clients: usize = std::env::var("REALBEAM_CLIENTS").map_or(Ok(50), |number| number.parse())?;
    let files = rlimit::increase_nofile_limit(8192)?;
    assert!(files >= 2 * clients as u64 + 100, "{clients} clients need more than the {files} files that there may be");
    let mut config = config()?;
    config.connections.max = clients + 1;
    // Nobody but the clients themselves ends their requests.
    (config.requests.body_time, config.connections.idle_time) = (Duration::from_hours(1), Duration::from_hours(1));
    let service = Service::with(&config)?;
    let addr = service.server.addr().tcp().ok_or("no TCP address")?;
    let body = Arc::new(bin()?);
    let expected = service.scan("?seed=7", &[], &body)?.success()?;

    let started = Instant::now();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    for wave in 1..=2 {
        let (go, told) = watch::channel(());
        let (mut vanishing, mut heads, mut bodies) = (JoinSet::new(), 0, 0);
        for i in 0..clients {
            let part = Part::ALL[i % Part::ALL.len()];
            heads += usize::from(part == Part::HalfAHead);
            bodies += usize::from(part == Part::HalfABody);
            let client = Vanishing { part, resets: (i / Part::ALL.len()).is_multiple_of(2) };
            vanishing.spawn_on(client.ask(addr, Arc::clone(&body), told.clone()), runtime.handle());
        }
        wait_until("half of the clients are in the middle of a request", || {
            Ok(service.gauge("realbeam_inflight_bytes")? >= bodies * body.len()
                && service.gauge("realbeam_connections")? > heads + bodies)
        })?;
        go.send(())?;
        while let Some(client) = runtime.block_on(vanishing.join_next()) {
            client?.map_err(|error| format!("wave {wave}: a client could not even ask: {error}"))?;
        }
        wait_until("everything that they took is back", || {
            let taken = ["realbeam_inflight_bytes", "realbeam_queue_depth"].map(|name| service.gauge(name));
            let taken = taken.into_iter().sum::<Result<usize>>()?;
            // The one that asks for this.
            Ok(taken == 0 && service.gauge("realbeam_connections")? == 1)
        })?;
        assert!(service.scan("?seed=7", &[], &body)?.success()? == expected);
    }
    println!("2 × {clients} clients vanished in {:.1} s", started.elapsed().as_secs_f64());
    let metrics = String::from_utf8(service.get("/metrics")?.success()?)?;
    assert!(!metrics.contains(r#"code="5"#), "{metrics}");
    assert!(metrics.lines().any(|line| line == "realbeam_refused_connections_total 0"), "{metrics}");
    Ok(())
}
