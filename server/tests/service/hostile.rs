//! Requests from an enemy: each is refused by its own status, none is the service's fault, and afterwards everything is as before.

use std::io::{ErrorKind, Read, Write};
use std::net::Shutdown;

use flate2::Compression;
use flate2::write::DeflateEncoder;
use lidar::PointCloud;
use lidar::formats::{self, Format};
use proto::MediaType;
use server::Config;

use crate::support::{Result, Service, bin, config, scan, wait_until};

/// A service under attack.
struct Target(Service);

impl Target {
    fn new() -> Result<Self> {
        Ok(Self(Service::start()?))
    }

    /// Sends a scan of a format.
    fn scan(&self, format: Format, body: &[u8]) -> Result<u16> {
        Ok(self.0.scan("", &[("content-type", MediaType::of_format(format).name)], body)?.status)
    }

    fn infer(&self, path: &str, header_length: Option<&str>, body: &[u8]) -> Result<u16> {
        let headers: Vec<_> =
            header_length.into_iter().map(|length| ("inference-header-content-length", length)).collect();
        Ok(self.0.post(&format!("/v2/models/{path}/infer"), &headers, body)?.status)
    }

    /// Sends bytes as they are; the status, or nothing if the connection is closed without one.
    fn raw(&self, request: &[u8], breaks_off: bool) -> Result<Option<u16>> {
        let mut stream = self.0.connect()?;
        // Whoever is refused early may be cut off while he still writes, or before he reads.
        let unless_cut_off = |done: std::io::Result<()>| match done.as_ref().err().map(std::io::Error::kind) {
            Some(ErrorKind::BrokenPipe | ErrorKind::ConnectionReset | ErrorKind::NotConnected) => Ok(()),
            _ => done,
        };
        unless_cut_off(stream.write_all(request))?;
        if breaks_off {
            unless_cut_off(stream.shutdown(Shutdown::Write))?;
        }
        let mut answer = Vec::new();
        unless_cut_off(stream.read_to_end(&mut answer).map(drop))?;
        let text = String::from_utf8_lossy(&answer);
        Ok(text.strip_prefix("HTTP/1.1 ").and_then(|text| text.get(..3)?.parse().ok()))
    }

    /// A good scan is answered, and nothing that the others took is missing.
    fn ends_as_it_began(self) -> Result {
        self.0.scan("", &[], &bin()?)?.success()?;
        wait_until("all shares of the memory are back", || {
            let metrics = String::from_utf8(self.0.get("/metrics")?.success()?)?;
            assert!(!metrics.contains(r#"code="5"#), "{metrics}");
            Ok(metrics.lines().any(|line| line == "realbeam_inflight_bytes 0"))
        })
    }
}

/// Bytes with some of them replaced.
fn with(bytes: &[u8], at: usize, by: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[at..at + by.len()].copy_from_slice(by);
    bytes
}

fn npy(shape: &str, body: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}");
    [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), body].concat()
}

/// A ZIP archive whose directory names one deflated member of zeros so many times.
fn bomb(zeros: usize, unpacked: u32, members: u16) -> Result<Vec<u8>> {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(&vec![0; zeros])?;
    let packed = encoder.finish()?;
    let sizes = [(packed.len() as u32).to_le_bytes(), unpacked.to_le_bytes()].concat();
    let shared = [&[20, 0, 0, 0, 8, 0, 0, 0, 33, 0, 0, 0, 0, 0][..], &sizes, &[5, 0, 0, 0]].concat();
    let mut archive = [b"PK\x03\x04", &shared[..], b"a.npy", &packed].concat();
    let directory = archive.len() as u32;
    for _ in 0..members {
        archive.extend([b"PK\x01\x02\x14\x00", &shared[..], &[0; 14], b"a.npy"].concat());
    }
    let size = archive.len() as u32 - directory;
    archive.extend([&b"PK\x05\x06\x00\x00\x00\x00"[..], &members.to_le_bytes(), &members.to_le_bytes()].concat());
    archive.extend([&size.to_le_bytes()[..], &directory.to_le_bytes(), &[0, 0]].concat());
    Ok(archive)
}

/// What it says, a scan that says it, and the status that it gets.
type Lie = (&'static str, Format, Vec<u8>, u16);

/// Scans whose headers promise what does not follow.
fn lying_scans() -> Result<Vec<Lie>> {
    let ply = |head: &str, body: &[u8]| {
        let head = format!(
            "ply\nformat binary_little_endian 1.0\n{head}property float x\nproperty float y\nproperty float z\nend_header\n"
        );
        [head.as_bytes(), body].concat()
    };
    let list = "element face 1\nproperty list uint int i\nelement vertex 1\n";
    let pcd = |points: &str, data: &str, body: &[u8]| {
        let head = format!("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {points}\nHEIGHT 1\nDATA {data}\n");
        [head.as_bytes(), body].concat()
    };
    let sizes = |packed: u32, unpacked: u32| [packed.to_le_bytes(), unpacked.to_le_bytes()].concat();
    let las = formats::encode(Format::Las, &scan())?;
    let laz = formats::encode(Format::Laz, &scan())?;
    // The old count of records goes before the new one, where it is not zero.
    let records = |file: &[u8], count: u64| with(&with(file, 107, &[0; 4]), 247, &count.to_le_bytes());
    let points = u32::from_le_bytes([laz[96], laz[97], laz[98], laz[99]]) as usize;
    let table = u32::from_le_bytes([laz[points], laz[points + 1], laz[points + 2], laz[points + 3]]) as usize;
    let cdr = formats::encode(Format::PointCloud2, &scan())?;
    let width = cdr.windows(4).position(|bytes| bytes == 5760_u32.to_le_bytes()).ok_or("no width")?;
    Ok(vec![
        ("more vertices than memory", Format::Ply, ply("element vertex 4000000000\n", &[0; 12]), 413),
        ("more vertices than bytes", Format::Ply, ply("element vertex 99999\n", &[0; 12]), 400),
        ("a negative number of vertices", Format::Ply, ply("element vertex -1\n", &[0; 12]), 400),
        ("a list longer than the file", Format::Ply, ply(list, &[255; 64]), 400),
        ("more records than memory", Format::Las, records(&las, u64::MAX), 413),
        ("more records than bytes", Format::Las, records(&las, 99_999), 400),
        ("points behind the end", Format::Las, with(&las, 96, &[255; 4]), 400),
        ("more VLRs than memory", Format::Las, with(&las, 100, &[255; 4]), 413),
        ("more chunks than memory", Format::Laz, with(&laz, table + 4, &[255; 4]), 413),
        ("no chunks", Format::Laz, with(&laz, table + 4, &[0; 4]), 400),
        ("a chunk table behind the end", Format::Laz, with(&laz, points, &i64::MAX.to_le_bytes()), 400),
        ("a chunk table of noise", Format::Laz, with(&laz, table + 8, &[255; 2]), 400),
        ("more compressed records than there are", Format::Laz, records(&laz, 99_999), 400),
        ("a shape that overflows", Format::Npy, npy("(4611686018427387904, 4)", &[0; 16]), 400),
        (
            "a shape that hides behind a zero",
            Format::Npy,
            npy("(0, 340282366920938463463374607431768211455)", &[]),
            400,
        ),
        ("a shape of more than the limit", Format::Npy, npy("(100001, 4)", &vec![0; 1_600_016]), 413),
        ("nested headers", Format::Npy, npy(&"(".repeat(60_000), &[]), 400),
        ("a bomb", Format::Npz, bomb(64 << 20, 64 << 20, 1)?, 413),
        ("a bomb that lies about itself", Format::Npz, bomb(64 << 20, 1000, 1)?, 400),
        ("a bomb that explodes a thousand times", Format::Npz, bomb(10 << 20, 10 << 20, 1000)?, 400),
        ("more members than an archive has", Format::Npz, bomb(100, 100, 65_535)?, 413),
        ("more packed bytes than there are", Format::Pcd, pcd("2", "binary_compressed", &sizes(u32::MAX, 24)), 400),
        ("other unpacked bytes", Format::Pcd, pcd("2", "binary_compressed", &sizes(2, u32::MAX)), 400),
        ("a small stream for many points", Format::Pcd, pcd("99999", "binary_compressed", &sizes(0, 1_199_988)), 400),
        ("more points than memory", Format::Pcd, pcd("18446744073709551615", "binary", &[0; 12]), 413),
        ("more points than bytes", Format::Pcd, pcd("99999", "binary", &[0; 12]), 400),
        ("a message wider than memory", Format::PointCloud2, with(&cdr, width, &[255; 4]), 413),
        ("a message wider than its bytes", Format::PointCloud2, with(&cdr, width, &99_999_u32.to_le_bytes()), 400),
    ])
}

#[test]
fn scans_that_promise_what_does_not_follow_are_refused() -> Result {
    let target = Target::new()?;
    for (what, format, body, expected) in lying_scans()? {
        assert_eq!(target.scan(format, &body)?, expected, "{what} ({format:?})");
    }
    target.ends_as_it_began()
}

#[test]
fn no_number_in_a_file_is_the_service_s_fault_nor_is_an_end_that_comes_too_early() -> Result {
    let target = Target::new()?;
    let cloud = scan();
    let few = PointCloud { ring: None, label: None, time_s: None, extra: Vec::new(), ..scan() };
    let few = PointCloud {
        x: few.x[..8].into(),
        y: few.y[..8].into(),
        z: few.z[..8].into(),
        intensity: few.intensity[..8].into(),
        ..few
    };
    for format in Format::ALL {
        let whole = formats::encode(format, &cloud)?;
        for sixteenth in 1..16 {
            // One byte less than a whole number of records, which formats without a header cannot tell from a smaller scan.
            let end = whole.len() * sixteenth / 16 - 1;
            let status = target.scan(format, &whole[..end])?;
            assert_eq!(status, 400, "{format:?} of {end} bytes");
        }
        let small = formats::encode(format, &few)?;
        for at in (0..small.len().min(800) - 4).step_by(3) {
            let status = target.scan(format, &with(&small, at, &[255; 4]))?;
            assert!([200, 400, 413, 422].contains(&status), "{format:?} with 0xffffffff at {at}: {status}");
        }
    }
    target.ends_as_it_began()
}

#[test]
fn points_that_are_nowhere_and_rings_beyond_counting_are_no_use() -> Result {
    let target = Target::new()?;
    for nowhere in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN_POSITIVE] {
        for model in ["passthrough", "hdl64e"] {
            let mut cloud = scan();
            cloud.intensity.fill(nowhere);
            let answer = target.0.scan(&format!("?model={model}"), &[], &formats::encode(Format::Kitti, &cloud)?)?;
            assert!([200, 422].contains(&answer.status), "intensity {nowhere}: {}", answer.status);
            for axis in [&mut cloud.x, &mut cloud.y, &mut cloud.z] {
                axis.fill(nowhere);
            }
            let answer = target.0.scan(&format!("?model={model}"), &[], &formats::encode(Format::Kitti, &cloud)?)?;
            // What is finite lies somewhere, in range or not.
            let expected: &[u16] = if nowhere.is_finite() { &[200, 422] } else { &[422] };
            assert!(expected.contains(&answer.status), "{nowhere}: {}", answer.status);
        }
    }
    let counts = |count: &str, rings: usize| vec![count; rings].join(",");
    for (counts, expected) in [
        (counts("4294967295", 16), 422),
        (counts("1", 16), 422),
        (counts("1", 20_000), 422),
        (counts("-1", 16), 400),
        (counts("99999999999", 16), 400),
    ] {
        let status = target.0.scan("", &[("x-ring-counts", &counts)], &bin()?)?.status;
        assert_eq!(status, expected, "{counts:.40}");
    }
    target.ends_as_it_began()
}

#[test]
fn tensors_that_contradict_themselves_are_refused() -> Result {
    let target = Target::new()?;
    let points = |shape: &str, rest: &str| {
        format!(r#"{{"inputs":[{{"name":"POINTS","shape":{shape},"datatype":"FP32",{rest}}}]}}"#)
    };
    let scan = |shape: &str, rest: &str| {
        format!(r#"{{"inputs":[{{"name":"scan","shape":{shape},"datatype":"FP32",{rest}}}]}}"#)
    };
    let deep = "[".repeat(100_000);
    let four = r#""data":[1,2,3,4]"#;
    let size = |bytes: u64| format!(r#""parameters":{{"binary_data_size":{bytes}}}"#);
    let two = |bytes: u64| {
        let input = format!(r#"{{"name":"POINTS","shape":[1,4],"datatype":"FP32",{}}}"#, size(bytes));
        format!(r#"{{"inputs":[{input},{input}]}}"#)
    };
    let many_names = (0..300_000).map(|i| format!(r#"{{"name":"{i}"}}"#)).collect::<Vec<_>>().join(",");
    let cases: Vec<(&str, Option<&str>, String, u16)> = vec![
        ("scan", None, deep.clone(), 400),
        ("scan", None, format!(r#"{{"inputs":{deep}"#), 400),
        ("scan", None, points("[1,4]", &format!(r#""data":{deep}"#)), 400),
        ("scan", None, format!(r#"{{"parameters":{{"a":{deep}"#), 400),
        ("scan", None, format!(r#"{{"a":{}"#, r#"{"a":"#.repeat(100_000)), 400),
        ("scan", None, points("[-1,-4]", four), 400),
        ("scan", None, points("[4294967296,4294967296]", four), 400),
        ("scan", None, points("[9223372036854775807,9223372036854775807]", r#""data":[]"#), 400),
        ("scan", None, points("[18446744073709551616,4]", four), 400),
        ("scan", None, points("[1.5,4]", four), 400),
        ("scan", None, points("[4]", four), 422),
        ("scan", None, points("[]", r#""data":[1]"#), 422),
        ("scan", None, points("[1,4]", r#""data":[1,2,3,1e999]"#), 400),
        ("scan", None, points(&format!("[{}4]", "1,".repeat(100_000)), four), 400),
        // Many times as large in memory, or the square of it in time, were it read to its end.
        ("scan", None, format!(r#"{{"inputs":[],"parameters":{{"a":[{}0]}}}}"#, "0,".repeat(3 << 20)), 400),
        ("scan", None, format!(r#"{{"inputs":[],"outputs":[{many_names}]}}"#), 400),
        ("scan", None, points("[1,4]", &size(u64::MAX)), 400),
        ("scan", None, two(1 << 63), 400),
        ("scan", Some("-1"), "{}".into(), 400),
        ("scan", Some("3"), "{}".into(), 400),
        ("scan", Some("18446744073709551616"), "{}".into(), 400),
        ("scan", Some("1e3"), "{}".into(), 400),
        ("passthrough", None, scan("[1,3,16,-360]", r#""data":[]"#), 400),
        ("passthrough", None, scan("[0,3,16,360]", r#""data":[]"#), 422),
        ("passthrough", None, scan("[1,3,16,0]", r#""data":[]"#), 422),
        ("passthrough", None, scan("[9223372036854775807,0,16,360]", r#""data":[]"#), 422),
        ("passthrough", Some("0"), String::new(), 400),
    ];
    for (model, header_length, body, expected) in cases {
        let status = target.infer(model, header_length, body.as_bytes())?;
        assert_eq!(status, expected, "{model} {header_length:?} {body:.120}");
    }
    target.ends_as_it_began()
}

#[test]
fn what_is_no_http_or_too_much_of_it_is_refused() -> Result {
    let target = Target::new()?;
    let post = |headers: &str, body: &str| {
        format!("POST /v1/scan HTTP/1.1\r\nhost: x\r\nconnection: close\r\n{headers}\r\n{body}").into_bytes()
    };
    let get = |path: &str| format!("GET {path} HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n").into_bytes();
    let long = "a".repeat(100_000);
    let many = |line: &str| (0..1000).map(|i| line.replace('#', &i.to_string())).collect::<String>();
    let query = "a&".repeat(15_000);
    let cases: Vec<(&str, Vec<u8>, u16)> = vec![
        ("a header of 100 kB", post(&format!("x-junk: {long}\r\n"), ""), 431),
        ("a header's name of 100 kB", post(&format!("{long}: x\r\n"), ""), 431),
        ("a thousand headers", post(&many("x-#: 1\r\n"), ""), 431),
        ("a hundred thousand parameters", get(&format!("/info?{}", "a=1&".repeat(100_000))), 431),
        ("parameters as many as fit", get(&format!("/sample?{query}")), 400),
        ("two lengths", post("content-length: 5\r\ncontent-length: 6\r\n", "aaaaaa"), 400),
        ("a negative length", post("content-length: -1\r\n", ""), 400),
        ("a length beyond numbers", post("content-length: 99999999999999999999999\r\n", ""), 400),
        ("a length beyond memory", post("content-length: 9999999999999999\r\n", "a"), 413),
        ("less than its length", post("content-length: 160\r\n", "aaaa"), 400),
        ("chunks of nonsense", post("transfer-encoding: chunked\r\n", "xyz\r\n"), 400),
        ("a chunk beyond numbers", post("transfer-encoding: chunked\r\n", "fffffffffffffffff\r\n"), 400),
        ("a chunk that ends early", post("transfer-encoding: chunked\r\n", "ff\r\naaaa"), 400),
        ("another transfer", post("transfer-encoding: gzip\r\n", "aaaa"), 400),
        ("another encoding", post("content-encoding: br\r\ncontent-length: 0\r\n", ""), 415),
        (
            "an encoding of 50 kB",
            post(&format!("content-encoding: {}\r\ncontent-length: 0\r\n", &long[..50_000]), ""),
            415,
        ),
        ("a type of 50 kB", post(&format!("content-type: {}\r\ncontent-length: 0\r\n", &long[..50_000]), ""), 415),
        ("a zero in a header", post("x-a: a\0b\r\n", ""), 400),
        (
            "a greeting in TLS",
            b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03aaaaaaaaaaaaaaaaaaaa\r\n\r\n".to_vec(),
            400,
        ),
        ("zeros", vec![0; 4096], 400),
        ("a path that is no text", get("/v2/models/%ff%fe"), 404),
        ("a path out of the folder", get("/v2/models/..%2f..%2fetc%2fpasswd"), 404),
        ("a version beyond numbers", get("/v2/models/scan/versions/99999999999999999999"), 404),
    ];
    for (what, request, expected) in cases {
        // Of a body that is announced, what is there is all that comes.
        let breaks_off = request.starts_with(b"POST") && [400, 413].contains(&expected);
        let status = target.raw(&request, breaks_off)?;
        // A head that is not read to its end may cost its sender the answer.
        assert!(status == Some(expected) || (status.is_none() && expected == 431), "{what}: {status:?}");
    }
    let whole = post(&format!("content-length: {}\r\n", bin()?.len()), "");
    for sixteenth in 0..16 {
        let body = &bin()?[..bin()?.len() * sixteenth / 16];
        assert_eq!(
            target.raw(&[&whole, body].concat(), true)?,
            Some(400),
            "{sixteenth} sixteenths of the announced body"
        );
    }
    target.ends_as_it_began()
}

#[test]
fn a_thousand_bombs_at_once_leave_the_service_as_it_was() -> Result {
    let mut config =
        Config { workers: server::WorkerOptions { workers: 2, threads: 1.into(), batch: 1, queue: 64 }, ..config()? };
    config.requests.max_inflight_bytes = 16 << 20;
    let target = Target(Service::with(&config)?);
    let lies = lying_scans()?;
    let sent = std::thread::scope(|scope| {
        let senders: Vec<_> = (0..8)
            .map(|sender| {
                let (target, lies) = (&target, &lies);
                scope.spawn(move || -> std::result::Result<usize, String> {
                    for i in 0..125 {
                        let (what, format, body, expected) = &lies[(sender + i * 3) % lies.len()];
                        let status = target.scan(*format, body).map_err(|error| error.to_string())?;
                        // So many at once may also be too many.
                        if status != *expected && status != 429 {
                            return Err(format!("{what}: {status}"));
                        }
                    }
                    Ok(125)
                })
            })
            .collect();
        senders
            .into_iter()
            .map(|sender| sender.join().unwrap_or_else(|_| Err("panicked".into())))
            .sum::<std::result::Result<usize, _>>()
    })?;
    assert_eq!(sent, 1000);
    target.ends_as_it_began()
}
