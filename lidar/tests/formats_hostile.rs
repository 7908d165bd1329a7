//! Files from an enemy: every reader answers, in bounded memory, whatever the bytes.
//!
//! The corpus runs in a child process whose address space is limited, so that one allocation by a crafted count ends it.
#![cfg(target_os = "linux")]

use std::fs;
use std::ops::Range;
use std::process::Command;
use std::time::{Duration, Instant};

use lidar::PointCloud;
use lidar::cloud::{Column, Values};
use lidar::formats::{Format, FormatError, Limits, decode, encode};

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Names the child's format.
const FORMAT: &str = "HOSTILE_FORMAT";
/// Address space of the child: its code, its stack, and what the bound below allows.
const ADDRESS_SPACE_KIB: usize = 128 * 1024;
const RANDOM_CASES: u64 = 3000;
const SLOWEST: Duration = Duration::from_secs(2);

/// Readers here accept few points, so that what a reader may take is small beside what a crafted count asks for.
fn limits() -> Limits {
    Limits { max_points: 20_000, max_unpacked_bytes: 3 << 20, ..Limits::default() }
}

/// The bound: 16 MiB, sixteen times the input, and what the accepted points take.
fn most_memory(input: usize) -> usize {
    (16 << 20) + 16 * input + limits().max_unpacked_bytes
}

#[test]
fn every_hostile_file_is_answered_in_bounded_memory() -> Outcome {
    for format in Format::ALL {
        let limited = format!("ulimit -v {ADDRESS_SPACE_KIB} && exec \"$0\" --exact --ignored --nocapture corpus");
        let child = Command::new("sh")
            .args(["-c", &limited])
            .arg(std::env::current_exe()?)
            .env(FORMAT, format.name())
            // One arena, because each thread's own would reserve 64 MiB of address space; and freed memory goes back at once, because
            // what stays would hide the next file's.
            .envs([("MALLOC_ARENA_MAX", "1"), ("MALLOC_TRIM_THRESHOLD_", "0"), ("MALLOC_MMAP_THRESHOLD_", "65536")])
            .env("RUST_BACKTRACE", "0")
            .output()?;
        let said = String::from_utf8_lossy(&child.stdout);
        println!("{}", said.lines().find(|line| line.contains("hostile files")).unwrap_or_default());
        let errors = String::from_utf8_lossy(&child.stderr);
        assert!(child.status.success(), "{format:?}: {}\n{said}\n{errors}", child.status);
    }
    Ok(())
}

#[test]
#[ignore = "run by the test above, under a memory limit"]
fn corpus() -> Outcome {
    let Some(format) = std::env::var(FORMAT).ok().and_then(|name| Format::from_name(&name)) else { return Ok(()) };
    let mut report = Report::default();
    // An honest file of as many points as are accepted: the bound holds for it, and the measure sees what it takes.
    report.decode(format, &encode(format, &cloud(limits().max_points))?);
    // The kernel counts pages in batches, so a peak may be some hundred KiB short of the truth.
    assert!(report.most_memory > 128 << 10, "{} bytes", report.most_memory);
    let honest = std::mem::take(&mut report).most_memory / 1024;
    for seed in seeds(format)? {
        assert!(decode(format, &seed, &limits()).is_ok(), "a seed of {format:?} is no file");
        truncated(&seed, |bytes| report.decode(format, bytes));
        overwritten(&seed, |bytes| report.decode(format, bytes));
        renumbered(&seed, |bytes| report.decode(format, bytes));
        flipped(&seed, |bytes| report.decode(format, bytes));
    }
    println!(
        "{}: {} hostile files, {} refused, {} panics caught, slowest {:?}, most memory {} KiB (honest: {honest})",
        format.name(),
        report.files,
        report.refused,
        report.caught,
        report.slowest,
        report.most_memory / 1024
    );
    assert!(report.slowest < SLOWEST, "{:?}", report.slowest);
    Ok(())
}

#[derive(Default)]
struct Report {
    files: usize,
    refused: usize,
    caught: usize,
    slowest: Duration,
    most_memory: usize,
}

impl Report {
    fn decode(&mut self, format: Format, bytes: &[u8]) {
        forget_peak();
        let before = memory("VmRSS:");
        let start = Instant::now();
        let decoded = decode(format, bytes, &limits());
        self.slowest = self.slowest.max(start.elapsed());
        let taken = memory("VmHWM:").saturating_sub(before);
        assert!(taken <= most_memory(bytes.len()), "{taken} bytes for an input of {}", bytes.len());
        self.most_memory = self.most_memory.max(taken);
        self.files += 1;
        match decoded {
            Ok(cloud) => {
                assert_eq!(cloud.check(), Ok(()));
                assert!(cloud.len() <= limits().max_points);
            }
            Err(error) => {
                // The arithmetic decoder of `laz` indexes by what it decodes: damaged streams panic there, and the reader catches it.
                let caught = error.to_string().contains("panicked");
                assert!(!caught || format == Format::Laz, "{error}");
                self.caught += usize::from(caught);
                self.refused += 1;
            }
        }
    }
}

/// Asks the kernel to measure the peak from now on.
fn forget_peak() {
    // Where it refuses, the peak is of the whole run and the bound only stricter.
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// A field of the process' status, in bytes.
fn memory(field: &str) -> usize {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(field)).unwrap_or_default();
    line.trim().trim_end_matches(" kB").parse::<usize>().unwrap_or(0) * 1024
}

/// Small honest files of a format, in each of its forms.
fn seeds(format: Format) -> Result<Vec<Vec<u8>>, FormatError> {
    let mut seeds = vec![encode(format, &cloud(12))?];
    match format {
        Format::Ply => {
            let head = "element face 1\nproperty list uchar int vertex_indices\nelement vertex 2\n\
                        property float x\nproperty double y\nproperty short z\nproperty uchar intensity\nend_header\n";
            seeds.push(format!("ply\nformat ascii 1.0\n{head}3 0 1 2\n1 2 3 4\n5 6 7 8\n").into_bytes());
            let mut big = format!("ply\nformat binary_big_endian 1.0\n{head}").into_bytes();
            big.extend([1, 0, 0, 0, 0]);
            big.extend([0; 30]);
            seeds.push(big);
        }
        Format::Pcd => {
            let head =
                "VERSION .7\nFIELDS x y z _ n\nSIZE 4 4 8 1 2\nTYPE F F F U I\nCOUNT 1 1 1 3 2\nWIDTH 2\nHEIGHT 1\n";
            seeds.push(format!("{head}DATA ascii\n1 2 3 0 0 0 4 5\n1 nan 3 0 0 0 4 5\n").into_bytes());
            let mut packed = format!("{head}DATA binary_compressed\n").into_bytes();
            packed.extend([[10, 0, 0, 0], [46, 0, 0, 0]].concat());
            // Four bytes, 41 of their repetition, one more.
            packed.extend([3, 1, 2, 3, 4, 224, 32, 3, 0, 7]);
            seeds.push(packed);
        }
        Format::Npy => {
            let head = b"\x93NUMPY\x01\x00\x46\x00{'descr': '>f8', 'fortran_order': True, 'shape': (2, 4), }".to_vec();
            let mut plain = [head, vec![b' '; 12], vec![0; 64]].concat();
            plain[8] = (plain.len() - 10 - 64) as u8;
            seeds.push(plain);
        }
        Format::PointCloud2 => {
            let golden = |name: &str| fs::read(format!("{}/tests/data/{name}.cdr", env!("CARGO_MANIFEST_DIR")));
            for name in ["xyzirc_big_endian_message", "ouster_organised", "every_datatype"] {
                let io = |source| FormatError::Io { path: name.into(), source };
                seeds.push(golden(name).map_err(io)?);
            }
        }
        Format::Las | Format::Laz => {
            for point_format in [1, 3, 8] {
                seeds.push(
                    las_of_format(point_format, format == Format::Laz)
                        .map_err(|error| FormatError::Library { library: "las", message: error.to_string() })?,
                );
            }
        }
        _ => {}
    }
    Ok(seeds)
}

fn cloud(points: usize) -> PointCloud {
    let ramp = |step: f32| (0..points).map(|i| i as f32 * step).collect::<Vec<_>>();
    PointCloud {
        x: ramp(0.5),
        y: ramp(-0.25),
        z: ramp(0.01),
        intensity: ramp(1.0),
        full_scale: 255.0,
        ring: Some((0..points).map(|i| i as u16).collect()),
        label: Some(vec![40; points]),
        time_s: Some((0..points).map(|i| i as f64 * 1e-6).collect()),
        return_number: Some(vec![1; points]),
        extra: vec![Column { name: "echo".into(), values: Values::I16(vec![-3; points]) }],
        ros: None,
    }
}

fn las_of_format(point_format: u8, is_compressed: bool) -> Result<Vec<u8>, las::Error> {
    let mut builder = las::Builder::default();
    builder.version = las::Version::new(1, 4);
    builder.point_format = las::point::Format::new(point_format)?;
    builder.point_format.is_compressed = is_compressed;
    builder.evlrs.push(las::Vlr { user_id: "someone".into(), data: vec![7; 40], ..las::Vlr::default() });
    let format = builder.point_format;
    let mut writer = las::Writer::new(std::io::Cursor::new(Vec::new()), builder.into_header()?)?;
    for i in 0..40 {
        writer.write_point(las::Point {
            x: f64::from(i),
            gps_time: format.has_gps_time.then_some(f64::from(i)),
            color: format.has_color.then(|| las::Color::new(i as u16, 2, 3)),
            nir: format.has_nir.then_some(9),
            ..las::Point::default()
        })?;
    }
    Ok(writer.into_inner()?.into_inner())
}

/// The file cut after each of its bytes.
fn truncated(seed: &[u8], mut each: impl FnMut(&[u8])) {
    (0..seed.len()).for_each(|end| each(&seed[..end]));
}

/// Each run of 2, 4 and 8 bytes replaced by the numbers that break arithmetic. The headers lie in the first part and at the end.
fn overwritten(seed: &[u8], mut each: impl FnMut(&[u8])) {
    let head: Range<usize> = 0..seed.len().min(1200);
    let tail = seed.len().saturating_sub(600).max(head.end)..seed.len();
    for start in head.chain(tail) {
        for value in [u64::MAX, 0, 1 << 62, 1 << 40, 0x8000_0000] {
            for width in [2, 4, 8] {
                let end = (start + width).min(seed.len());
                let mut bytes = seed.to_vec();
                bytes[start..end].copy_from_slice(&value.to_le_bytes()[..end - start]);
                if bytes != seed {
                    each(&bytes);
                }
            }
        }
    }
}

/// Each written number of a text header replaced.
fn renumbered(seed: &[u8], mut each: impl FnMut(&[u8])) {
    let is_digit = |i: usize| seed.get(i).is_some_and(u8::is_ascii_digit);
    for start in (0..seed.len().min(4096)).filter(|&i| is_digit(i) && (i == 0 || !is_digit(i - 1))) {
        let end = (start..=seed.len()).find(|&i| !is_digit(i)).unwrap_or(seed.len());
        let huge = "1".to_owned() + &"0".repeat(30);
        for number in ["4294967295", "4611686018427387904", "18446744073709551616", &huge, &huge.repeat(4), "-1", "0"] {
            each(&[&seed[..start], number.as_bytes(), &seed[end..]].concat());
        }
    }
}

/// Up to eight random bytes replaced.
fn flipped(seed: &[u8], mut each: impl FnMut(&[u8])) {
    for case in 0..RANDOM_CASES {
        let mut random = case;
        let mut bytes = seed.to_vec();
        for _ in 0..=case % 8 {
            let random = split_mix(&mut random);
            let place = (random >> 8) as usize % bytes.len();
            bytes[place] = random as u8;
        }
        each(&bytes);
    }
}

/// `SplitMix64` (Steele, Lea, Flood, 2014): the same numbers on every machine and for ever.
fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
