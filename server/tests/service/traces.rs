//! What an OpenTelemetry collector gets to see.

#[cfg(feature = "otlp")]
use std::io::{BufRead, BufReader, Read, Write};
#[cfg(feature = "otlp")]
use std::net::{TcpListener, TcpStream};
#[cfg(feature = "otlp")]
use std::sync::mpsc;

use crate::support::{Result, Service, config};

/// Takes one request of OTLP, tells its body, and only then answers.
#[cfg(feature = "otlp")]
fn take(stream: TcpStream, told: &mpsc::Sender<(String, Vec<u8>)>) -> Result {
    let mut reader = BufReader::new(stream);
    let (mut first, mut length) = (String::new(), 0);
    reader.read_line(&mut first)?;
    loop {
        let mut line = String::new();
        reader.read_line(&mut line)?;
        match line.trim_end().to_ascii_lowercase().split_once(": ") {
            Some(("content-length", bytes)) => length = bytes.parse()?,
            Some(_) => {}
            None => break,
        }
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body)?;
    told.send((first, body))?;
    reader.into_inner().write_all(b"HTTP/1.1 200 OK\r\nconnection: close\r\ncontent-length: 0\r\n\r\n")?;
    Ok(())
}

#[cfg(feature = "otlp")]
#[test]
fn a_collector_gets_each_request_with_its_stages_under_the_client_s_own_trace() -> Result {
    let collector = TcpListener::bind("127.0.0.1:0")?;
    let mut config = config()?;
    config.otlp = Some(format!("http://{}/v1/traces", collector.local_addr()?));
    let (told, asked) = mpsc::channel();
    std::thread::spawn(move || collector.incoming().flatten().for_each(|stream| drop(take(stream, &told))));
    let service = Service::with(&config)?;
    let headers = [
        ("traceparent", "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"),
        ("x-request-id", "the-first-one"),
        ("content-type", "application/octet-stream"),
    ];
    service.scan("?seed=7", &headers, &crate::support::bin()?)?.success()?;
    assert_eq!(service.scan("?sed=7", &[], &[])?.status, 400);
    service.get("/info")?.success()?;
    // Whatever has not been sent yet is sent at the end.
    service.server.stop()?;
    let (lines, bodies): (Vec<_>, Vec<_>) = asked.try_iter().unzip();
    assert!(!lines.is_empty() && lines.iter().all(|line| line == "POST /v1/traces HTTP/1.1\r\n"), "{lines:?}");
    let bodies = bodies.concat();
    let count = |words: &[u8]| bodies.windows(words.len()).filter(|found| *found == words).count();
    assert_eq!((count(b"POST /v1/scan"), count(b"GET /info"), count(b"the-first-one")), (2, 1, 1));
    for stage in server::stopwatch::Stage::ALL {
        assert_eq!(count(stage.name().as_bytes()), 1, "only one request came as far as stage {}", stage.name());
    }
    let (trace, span) = (0x0af7_6519_16cd_43dd_8448_eb21_1c80_319c_u128, 0xb7ad_6b71_6920_3331_u64);
    // The request and its eight stages; the client's span is the parent of one.
    assert_eq!((count(&trace.to_be_bytes()), count(&span.to_be_bytes())), (9, 1));
    Ok(())
}

#[cfg(not(feature = "otlp"))]
#[test]
fn a_program_without_traces_says_so_to_whoever_asks_for_them() -> Result {
    let mut config = config()?;
    config.otlp = Some("http://127.0.0.1:4318/v1/traces".into());
    let error = Service::with(&config).err().map(|error| error.to_string());
    let expected =
        "no traces can be sent to http://127.0.0.1:4318/v1/traces: this program was built without the feature `otlp`";
    assert_eq!(error.as_deref(), Some(expected));
    Ok(())
}
