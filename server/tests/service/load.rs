//! What the service does when it is asked for more than it can do.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

use proto::{ErrorBody, ErrorCode};

use crate::support::{Answer, Result, Service, bin, config, wait_until};

/// Query of the stand-in whose run takes longest: 64 × 2048.
const SLOW: &str = "?model=hdl64e";

/// A connection on which a request of so many bytes is under way, half of it sent.
pub(crate) fn half_sent(service: &Service, bytes: usize) -> Result<TcpStream> {
    let mut stream = service.connect()?;
    write!(stream, "POST /v1/scan HTTP/1.1\r\nhost: x\r\nconnection: close\r\ncontent-length: {bytes}\r\n\r\n")?;
    stream.write_all(&vec![0; bytes / 2])?;
    Ok(stream)
}

/// What the service says on a connection until it closes it.
fn rest(stream: &mut TcpStream) -> Result<String> {
    stream.set_read_timeout(Some(Duration::from_secs(20)))?;
    let mut text = String::new();
    stream.read_to_string(&mut text)?;
    Ok(text)
}

fn error_of(text: &str) -> Result<(u16, ErrorBody)> {
    let (head, body) = text.split_once("\r\n\r\n").ok_or_else(|| format!("no answer: `{text}`"))?;
    let status = head.split(' ').nth(1).ok_or("no status")?;
    Ok((status.parse()?, serde_json::from_str(body)?))
}

#[test]
fn who_finds_the_queue_full_is_turned_away_and_nobody_fails_otherwise() -> Result {
    let mut config = config()?;
    config.workers.queue = 1;
    let service = Service::with(&config)?;
    let body = bin()?;
    service.scan(SLOW, &[], &body)?.success()?;
    let ask =
        || -> std::result::Result<Answer, String> { service.scan(SLOW, &[], &body).map_err(|error| error.to_string()) };
    let answers: Vec<_> = thread::scope(|scope| {
        let clients: Vec<_> = (0..8).map(|_| scope.spawn(|| (0..10).map(|_| ask()).collect::<Vec<_>>())).collect();
        clients.into_iter().flat_map(|client| client.join().unwrap_or_default()).collect()
    });
    assert_eq!(answers.len(), 80);
    let mut refused = 0;
    for answer in answers {
        let answer = answer?;
        if answer.status == 200 {
            continue;
        }
        assert_eq!((answer.error()?.code, answer.header("retry-after")), (ErrorCode::Overloaded, "1"));
        refused += 1;
    }
    assert!((1..80).contains(&refused), "{refused} of 80 were turned away");
    Ok(())
}

#[test]
fn where_nobody_may_wait_whoever_comes_alone_is_answered_all_the_same() -> Result {
    let mut config = config()?;
    config.workers.queue = 0;
    let service = Service::with(&config)?;
    let body = bin()?;
    // One after the other, each as soon as the one before is answered; the second model's workers start with its first scan.
    for i in 0..200 {
        let query = if i % 2 == 0 { "" } else { "?model=ghosts" };
        service.scan(query, &[], &body)?.success().map_err(|error| format!("scan {i}: {error}"))?;
    }
    let ask = || service.scan(SLOW, &[], &body).map(|answer| answer.status).map_err(|error| error.to_string());
    let statuses = thread::scope(|scope| {
        let clients: Vec<_> = (0..8).map(|_| scope.spawn(|| (0..5).map(|_| ask()).collect::<Vec<_>>())).collect();
        clients.into_iter().flat_map(|client| client.join().unwrap_or_default()).collect::<Vec<_>>()
    });
    let statuses = statuses.into_iter().collect::<std::result::Result<Vec<_>, _>>()?;
    let number = |status: u16| statuses.iter().filter(|found| **found == status).count();
    assert!(number(200) > 0 && number(429) > 0 && number(200) + number(429) == 40, "{statuses:?}");
    Ok(())
}

#[test]
fn bodies_are_let_in_by_their_announced_length_and_the_others_told_to_wait() -> Result {
    let mut config = config()?;
    (config.requests.max_body_bytes, config.requests.max_inflight_bytes) = (200_000, 300_000);
    // What is half sent stays so, however slow the machine.
    config.requests.body_time = Duration::from_mins(10);
    let service = Service::with(&config)?;
    let body = bin()?;
    assert_eq!(body.len(), 92_160);
    let are_under_way = |bytes: usize| {
        wait_until(&format!("{bytes} bytes are under way"), || {
            let metrics = String::from_utf8(service.get("/metrics")?.success()?)?;
            Ok(metrics.lines().any(|line| line == format!("realbeam_inflight_bytes {bytes}")))
        })
    };
    let mut first = half_sent(&service, 192_000)?;
    service.scan("", &[], &body)?.success()?;
    // An answer may be read before the service knows that it has left.
    are_under_way(192_000)?;
    let second = half_sent(&service, 96_000)?;
    // A third one that came before the head of the second one is read would take its place.
    are_under_way(288_000)?;
    let refused = service.scan("", &[], &body)?;
    assert_eq!((refused.error()?.code, refused.header("retry-after")), (ErrorCode::TooManyBytes, "1"));
    assert!(refused.error()?.error.contains("bodies of 288000 bytes are under way"), "{}", refused.error()?.error);
    drop(second);
    first.write_all(&vec![0; 96_000])?;
    assert!(rest(&mut first)?.starts_with("HTTP/1.1 422"), "all points lie at the origin");
    service.scan("", &[], &body)?.success()?;
    Ok(())
}

#[test]
fn whoever_vanishes_leaves_nothing_behind() -> Result {
    let mut config = config()?;
    (config.requests.max_body_bytes, config.requests.max_inflight_bytes) = (200_000, 200_000);
    config.workers.queue = 2;
    let service = Service::with(&config)?;
    let body = bin()?;
    for i in 0..300 {
        let mut stream = half_sent(&service, body.len())?;
        if i % 2 == 0 {
            stream.write_all(&body[body.len() / 2..])?;
        }
        if i % 3 == 0 {
            stream.shutdown(Shutdown::Both)?;
        }
    }
    // As large as the whole budget, so that nobody else can have a share of it.
    let whole = vec![0; 200_000];
    let until = Instant::now() + Duration::from_secs(10);
    while service.scan("", &[], &whole)?.error()?.code == ErrorCode::TooManyBytes {
        assert!(Instant::now() < until, "shares of the budget are lost");
    }
    service.scan("", &[], &body)?.success()?;
    Ok(())
}

#[test]
fn an_answer_that_would_come_too_late_is_504() -> Result {
    let service = Service::start()?;
    let body = bin()?;
    // The way of so small a scan may take less than a millisecond; to draw and pack a picture of 64 × 2048 takes many.
    let ask = |ms: &str| service.scan(SLOW, &[("accept", "image/png"), ("x-deadline-ms", ms)], &body);
    ask("20000")?.success()?;
    assert_eq!(ask("1")?.error()?.code, ErrorCode::DeadlineExceeded);
    ask("20000")?.success()?;
    Ok(())
}

#[test]
fn of_a_live_stream_a_scan_that_waits_gives_way_to_a_later_one() -> Result {
    let service = Service::start()?;
    let body = bin()?;
    service.scan(SLOW, &[], &body)?.success()?;
    let live = |query: &str| service.scan(query, &[("x-stream-id", "ego"), ("x-stream-mode", "latest")], &body);
    for _ in 0..20 {
        // One for the worker, one that waits, others that come later.
        let ask = || live(SLOW).map(|answer| answer.status).map_err(|error| error.to_string());
        let statuses = thread::scope(|scope| {
            let clients: Vec<_> = (0..8).map(|_| scope.spawn(ask)).collect();
            clients
                .into_iter()
                .map(|client| client.join().unwrap_or_else(|_| Err("a client panicked".into())))
                .collect::<Vec<_>>()
        });
        let statuses = statuses.into_iter().collect::<std::result::Result<Vec<_>, _>>()?;
        // On a busy machine they may come in another order; whichever comes last is answered.
        assert!(statuses.iter().all(|status| [200, 409].contains(status)) && statuses.contains(&200), "{statuses:?}");
        if statuses.contains(&409) {
            return Ok(());
        }
    }
    Err("in 20 tries no scan gave way to a later one".into())
}

#[test]
fn slow_bodies_slow_heads_and_silence_are_not_waited_for() -> Result {
    let mut config = config()?;
    config.requests.body_time = Duration::from_millis(300);
    config.connections.idle_time = Duration::from_millis(600);
    let service = Service::with(&config)?;
    let mut slow_body = half_sent(&service, 1000)?;
    let (status, error) = error_of(&rest(&mut slow_body)?)?;
    assert_eq!((status, error.code), (408, ErrorCode::BodyTooSlow));
    assert!(error.error.contains("within 0.3 s"), "{}", error.error);

    let started = Instant::now();
    let mut silent = service.connect()?;
    let mut slow_head = service.connect()?;
    // The beginning of HTTP/2's preface tells not yet which version will be spoken.
    let mut undecided = service.connect()?;
    slow_head.write_all(b"GET /info HTTP/1.1\r\nhost:")?;
    undecided.write_all(b"PRI * HT")?;
    for stream in [&mut silent, &mut slow_head, &mut undecided] {
        let said = rest(stream)?;
        assert!(said.is_empty() || said.starts_with("HTTP/1.1 4"), "{said}");
    }
    let elapsed = started.elapsed();
    assert!(elapsed > Duration::from_millis(500) && elapsed < Duration::from_secs(10), "{elapsed:?}");
    service.scan("", &[], &bin()?)?.success()?;
    Ok(())
}

#[test]
fn one_connection_too_many_is_told_so() -> Result {
    let mut config = config()?;
    config.connections.max = 2;
    let service = Service::with(&config)?;
    let open: Vec<TcpStream> = (0..2).map(|_| half_sent(&service, 1000)).collect::<Result<_>>()?;
    let (status, error) = error_of(&rest(&mut half_sent(&service, 1000)?)?)?;
    assert_eq!((status, error.code), (503, ErrorCode::TooManyConnections));
    assert!(error.error.starts_with("2 connections are open already"), "{}", error.error);
    drop(open);
    let until = Instant::now() + Duration::from_secs(10);
    while service.scan("", &[], &bin()?)?.status != 200 {
        assert!(Instant::now() < until, "places for connections are lost");
    }
    Ok(())
}
