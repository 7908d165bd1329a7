//! What an answer says about itself, and that it is the same for the same question.

use std::thread;
use std::time::Duration;

use lidar::formats::{self, Format};
use server::{Threads, WorkerOptions};

use crate::support::{Answer, Result, Service, bin, config, scan};

#[test]
fn one_seed_gives_one_answer_whatever_else_runs() -> Result {
    let mut config = config()?;
    config.workers = WorkerOptions { workers: 2, threads: 2.into(), ..config.workers };
    let service = Service::with(&config)?;
    let body = bin()?;
    let expected = service.scan("?seed=7", &[], &body)?.success()?;
    assert!(service.scan("?seed=8", &[], &body)?.success()? != expected, "another seed is another answer");
    // This one keeps every ray: only its noise depends on the seed.
    let misbehaved = Service::misbehaved()?;
    let unruly = |seed: u64| misbehaved.scan(&format!("?seed={seed}"), &[], &body).and_then(Answer::success);
    assert!(unruly(7)? != unruly(8)?, "another seed is other noise");
    assert!(unruly(7)? == unruly(7)?);
    let answers = thread::scope(|scope| {
        let ask = |i: u64| {
            let (service, body) = (&service, &body);
            scope.spawn(move || {
                let seed = if i.is_multiple_of(2) { 7 } else { i };
                service.scan(&format!("?seed={seed}"), &[], body).and_then(Answer::success).map_err(|e| e.to_string())
            })
        };
        let threads: Vec<_> = (0..16).map(ask).collect();
        threads.into_iter().map(|thread| thread.join().map_err(|_| "a client panicked".to_owned())?).collect::<Vec<_>>()
    });
    for (i, answer) in answers.into_iter().enumerate() {
        assert_eq!(answer? == expected, i % 2 == 0 || i == 7, "request {i}");
    }
    // Another process may have other threads; one thread gives the same.
    assert!(Service::start()?.scan("?seed=7", &[], &body)?.success()? == expected);
    config.workers.threads = Threads { number: 2, spin: Duration::ZERO };
    assert!(Service::with(&config)?.scan("?seed=7", &[], &body)?.success()? == expected);
    Ok(())
}

/// Scans that come together are run together, and nobody can tell.
#[test]
fn an_answer_is_the_same_alone_and_in_company() -> Result {
    let mut config = config()?;
    let body = bin()?;
    let query = |i: usize| format!("?model={}&seed={i}", ["passthrough", "hdl64e", "ghosts"][i % 3]);
    let alone = Service::with(&config)?;
    let alone = (0..24).map(|i| alone.scan(&query(i), &[], &body)?.success()).collect::<Result<Vec<_>>>()?;
    config.workers = WorkerOptions { workers: 2, batch: 4, ..config.workers };
    let service = Service::with(&config)?;
    let in_company = thread::scope(|scope| {
        let ask = |i| service.scan(&query(i), &[], &body).and_then(Answer::success).map_err(|error| error.to_string());
        let asked: Vec<_> = (0..24).map(|i| scope.spawn(move || ask(i))).collect();
        asked.into_iter().map(|asked| asked.join().map_err(|_| "a client panicked".to_owned())?).collect::<Vec<_>>()
    });
    for (i, answer) in in_company.into_iter().enumerate() {
        assert!(answer? == alone[i], "scan {i}");
    }
    Ok(())
}

#[test]
fn the_seed_is_zero_unless_given_and_noise_moves_points_along_their_rays() -> Result {
    let service = Service::start()?;
    let answer = service.scan("", &[], &bin()?)?;
    assert_eq!(answer.header("x-realbeam-seed"), "0");
    let decode = |bytes: &[u8]| formats::decode(Format::Kitti, bytes, &formats::Limits::default());
    let (sent, got) = (scan(), decode(&answer.success()?)?);
    let (mut moved, mut farthest_m) = (0, 0.0f32);
    let mut j = 0;
    for i in 0..got.len() {
        // Answers keep the order of the points: look for the sent point on the same ray.
        let along = |j: usize| {
            let (a, b) = ([sent.x[j], sent.y[j], sent.z[j]], [got.x[i], got.y[i], got.z[i]]);
            let dot: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
            dot / (sent.range_m(j) * got.range_m(i))
        };
        // The nearest other ray is a degree away: a cosine of 0.99985.
        while along(j) < 0.99999 {
            j += 1;
        }
        let by_m = got.range_m(i) - sent.range_m(j);
        // 1 cm of noise, and the rounding of 45 m in single precision.
        assert!((-1e-5..0.01 + 1e-5).contains(&by_m), "moved by {by_m} m");
        moved += usize::from(by_m > 1e-4);
        farthest_m = farthest_m.max(by_m);
        assert!((got.intensity[i] - 0.8 * sent.intensity[j]).abs() < 1e-6);
    }
    assert!(moved * 10 > got.len() * 9, "{moved} of {} points moved", got.len());
    // The numbers that drop rays where they are above 0.9 are not the model's noise: that one reaches 1.
    assert!(farthest_m > 0.0095, "{farthest_m}");
    Ok(())
}

#[test]
fn without_noise_the_same_rays_are_dropped_and_the_others_lie_in_the_middle() -> Result {
    let service = Service::start()?;
    let ask = |query: &str| -> Result<lidar::PointCloud> {
        let answer = service.scan(query, &[("accept", "model/x-ply")], &bin()?)?.success()?;
        Ok(formats::decode(Format::Ply, &answer, &formats::Limits::default())?)
    };
    let (drawn, median) = (ask("?seed=7")?, ask("?seed=7&noise=median")?);
    assert!(ask("?seed=7&noise=drawn")? == drawn);
    assert_eq!(drawn.len(), median.len());
    assert!(median.len() < scan().len(), "ray drop is drawn all the same");
    assert!(ask("?seed=8&noise=median")?.x != median.x);
    // Drawn noise is up to 1 cm, its middle half of that; 1e-5 m is the rounding of 45 m in single precision.
    let apart_m = (0..drawn.len()).map(|i| drawn.range_m(i) - median.range_m(i));
    assert!(apart_m.clone().all(|m| m.abs() < 0.005 + 1e-5), "the same rays");
    assert!(apart_m.map(f32::abs).sum::<f32>() > 0.002 * drawn.len() as f32, "and not the same noise");
    Ok(())
}

#[test]
fn what_a_model_gets_wrong_does_not_reach_the_answer() -> Result {
    let answer = Service::misbehaved()?.scan("", &[], &bin()?)?.success()?;
    let (sent, got) = (scan(), formats::decode(Format::Kitti, &answer, &formats::Limits::default())?);
    // Negative and infinite ranges are no returns: half the rays. Standard deviation √(0.5·0.5/5760) = 0.0066; five of them.
    let share = got.len() as f64 / sent.len() as f64;
    assert!((share - 0.5).abs() < 0.033, "{share}");
    assert!((0..got.len()).all(|i| (2.4..46.0).contains(&got.range_m(i))), "ranges of 5 to 45 m, or half of that");
    assert!(got.intensity.iter().all(|i| (0.0..=1.0).contains(i)));
    assert!(got.intensity.contains(&0.0) && got.intensity.contains(&1.0), "held, not scaled");
    Ok(())
}

#[test]
fn the_counts_of_points_add_up() -> Result {
    let mut cloud = scan();
    let n = cloud.len();
    (cloud.x[0], cloud.x[1]) = (f32::NAN, f32::INFINITY);
    (cloud.x[2], cloud.y[2], cloud.z[2]) = (0.0, 0.0, 0.0);
    // Farther than the sensor sees; above all rings; in front of point 10.
    (cloud.x[3], cloud.y[3]) = (500.0, 0.0);
    (cloud.x[4], cloud.y[4], cloud.z[4]) = (0.1, 0.0, 9.0);
    (cloud.x[5], cloud.y[5], cloud.z[5]) = (cloud.x[10] * 0.9, cloud.y[10] * 0.9, cloud.z[10] * 0.9);
    let service = Service::start()?;
    let answer = service.scan("", &[], &formats::encode(Format::Kitti, &cloud)?)?;
    let count = |name: &str| answer.number(&format!("x-realbeam-points-{name}"));
    assert_eq!((count("in")?, count("invalid")?, count("out-of-range")?, count("lost")?), (n as u64, 3, 2, 1));
    let parts = count("kept")? + count("dropped")? + count("lost")? + count("invalid")? + count("out-of-range")?;
    assert_eq!(parts, count("in")?);
    let kept = count("kept")?;
    assert_eq!(answer.success()?.len() as u64, 16 * kept);
    Ok(())
}

#[test]
fn the_answer_names_its_model_and_the_time_of_every_stage() -> Result {
    let service = Service::start()?;
    let answer = service.scan("?version=1", &[("x-request-id", "frame-17")], &bin()?)?;
    assert_eq!(answer.header("x-request-id"), "frame-17");
    assert_eq!((answer.header("x-realbeam-model"), answer.header("x-realbeam-model-version")), ("passthrough", "1"));
    let digest = answer.header("x-realbeam-model-digest");
    assert!(digest.starts_with("sha256:") && digest.len() == 7 + 64, "{digest}");
    assert_eq!((answer.header("x-realbeam-grid-coverage"), answer.header("x-realbeam-warning")), ("1.0000", ""));
    let stages: Vec<_> = answer.header("server-timing").split(", ").filter_map(|s| s.split_once(";dur=")).collect();
    let names: Vec<_> = stages.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, ["queue", "decode", "project", "tensor", "infer", "sample", "reconstruct", "encode"]);
    for (name, ms) in stages {
        assert!(ms.parse::<f64>()? > 0.0, "{name}");
    }
    Ok(())
}

#[test]
fn a_scan_of_another_sensor_is_answered_with_what_to_simulate() -> Result {
    let service = Service::start()?;
    let cloud = scan();
    let keep = |wish: &dyn Fn(usize) -> bool| -> Result<Vec<u8>> {
        let indices: Vec<u32> = (0..cloud.len()).filter(|i| wish(*i)).map(|i| i as u32).collect();
        Ok(formats::encode(Format::Kitti, &cloud.select(&indices))?)
    };
    let ring = |i: usize| i % 16;
    let every_fourth_ring = service.scan("", &[], &keep(&|i| ring(i) % 4 == 0)?)?;
    assert_eq!(every_fourth_ring.header("x-realbeam-grid-coverage"), "0.2500");
    assert_eq!(
        every_fourth_ring.header("x-realbeam-warning"),
        "the scan has points on 4 of the model's 16 rings; simulate 16 rings from +15.0 to -15.0 deg with 360 columns; GET /info has \
         the list"
    );
    let front_half = service.scan("", &[], &keep(&|i| cloud.x[i] > 0.0)?)?;
    assert_eq!(front_half.header("x-realbeam-warning"), "the scan covers 180 of 360 degrees: send whole sweeps");
    Ok(())
}
