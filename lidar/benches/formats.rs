//! Speed of the readers and writers: a scan of 120,000 points. `cargo bench -p lidar --bench formats`

use divan::Bencher;
use divan::counter::BytesCount;
use lidar::PointCloud;
use lidar::formats::{Format, Limits, decode, encode};

fn main() {
    divan::main();
}

const POINTS: usize = 120_000;

/// 64 rings around a sensor over uneven ground, with ring, label and time.
fn scan() -> PointCloud {
    let columns = POINTS / 64;
    let range_m = |i: usize| 6.0 + 20.0 * (i as f32 * 0.000_37).sin().abs() + (i * 7919 % 100) as f32 * 0.002;
    let azimuth_rad = |i: usize| (i % columns) as f32 / columns as f32 * std::f32::consts::TAU;
    PointCloud {
        x: (0..POINTS).map(|i| range_m(i) * azimuth_rad(i).cos()).collect(),
        y: (0..POINTS).map(|i| range_m(i) * azimuth_rad(i).sin()).collect(),
        z: (0..POINTS).map(|i| range_m(i) * 0.01 * (i / columns) as f32 - 1.7).collect(),
        intensity: (0..POINTS).map(|i| (i * 31 % 256) as f32).collect(),
        full_scale: 255.0,
        ring: Some((0..POINTS).map(|i| (i / columns) as u16).collect()),
        label: Some((0..POINTS).map(|i| 40 + (i / 1000 % 12) as u32).collect()),
        time_s: Some((0..POINTS).map(|i| (i % columns) as f64 * 0.1 / columns as f64).collect()),
        ..PointCloud::default()
    }
}

/// x, y, z and intensity alone.
fn bare_scan() -> PointCloud {
    PointCloud { ring: None, label: None, time_s: None, ..scan() }
}

#[divan::bench(args = Format::ALL.map(Format::name))]
fn read(bencher: Bencher<'_, '_>, format: &str) {
    bench_read(bencher, format, &scan());
}

#[divan::bench(args = ["ply", "las", "laz"])]
fn read_bare(bencher: Bencher<'_, '_>, format: &str) {
    bench_read(bencher, format, &bare_scan());
}

#[divan::bench(args = ["ply", "pcd"])]
fn read_text(bencher: Bencher<'_, '_>, format: &str) {
    let cloud = scan();
    let header = match format {
        "ply" => format!(
            "ply\nformat ascii 1.0\nelement vertex {POINTS}\nproperty float x\nproperty float y\nproperty float z\n\
             property uchar intensity\nend_header\n"
        ),
        _ => format!("FIELDS x y z intensity\nSIZE 4 4 4 1\nTYPE F F F U\nWIDTH {POINTS}\nHEIGHT 1\nDATA ascii\n"),
    };
    let line = |i: usize| format!("{} {} {} {}\n", cloud.x[i], cloud.y[i], cloud.z[i], cloud.intensity[i]);
    let bytes = header + &(0..POINTS).map(line).collect::<String>();
    let Some(format) = Format::from_name(format) else { return };
    bencher.counter(BytesCount::new(bytes.len())).bench(|| decode(format, bytes.as_bytes(), &Limits::default()));
}

fn bench_read(bencher: Bencher<'_, '_>, format: &str, cloud: &PointCloud) {
    let Some(format) = Format::from_name(format) else { return };
    let Ok(bytes) = encode(format, cloud) else { return };
    bencher.counter(BytesCount::new(bytes.len())).bench(|| decode(format, &bytes, &Limits::default()));
}

#[divan::bench(args = Format::ALL.map(Format::name))]
fn write(bencher: Bencher<'_, '_>, format: &str) {
    let Some(format) = Format::from_name(format) else { return };
    let cloud = scan();
    let Ok(bytes) = encode(format, &cloud) else { return };
    bencher.counter(BytesCount::new(bytes.len())).bench(|| encode(format, &cloud));
}
