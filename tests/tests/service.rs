//! The service on the models that ship, with real files of every format.

use std::path::{Path, PathBuf};

use lidar::PointCloud;
use lidar::formats::{self, Format, Limits};
use proto::MediaType;
use tests::{RunningServer, models};

/// Query, headers, body, and the status that answers them.
type Case = (&'static str, Vec<(&'static str, &'static str)>, Vec<u8>, u16);

type Fact = Result<(), Box<dyn std::error::Error>>;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data").join(name)
}

/// A real file of each format; see tests/data/README.md.
fn real_files() -> Vec<(Format, PathBuf)> {
    let file = |format: Format| match format {
        Format::Pcd => data("vlp16.pcd"),
        _ => data(&format!("hdl32e.{}", format.extension())),
    };
    Format::ALL.into_iter().map(|format| (format, file(format))).collect()
}

fn serve() -> Result<RunningServer, Box<dyn std::error::Error>> {
    Ok(RunningServer::start(&models(), &["--default-model", "hdl32e"])?)
}

#[test]
fn real_files_of_every_format_come_back_in_their_own() -> Fact {
    let server = serve()?;
    for (format, path) in real_files() {
        let (bytes, media) = (std::fs::read(&path)?, MediaType::of_format(format).name);
        let before = formats::decode(format, &bytes, &Limits::default())?;
        let answer = server.client().scan("", &[("content-type", media)], &bytes)?;
        assert_eq!(answer.status, 200, "{}: {}", format.name(), answer.text());
        assert_eq!(answer.header("content-type"), Some(media));
        let after = formats::decode(format, &answer.body, &Limits::default())?;
        let count = |name: &str| answer.count(&format!("x-realbeam-points-{name}"));
        assert_eq!(count("in")?, before.len(), "{}", format.name());
        assert_eq!(count("kept")?, after.len(), "{}", format.name());
        let gone = count("dropped")? + count("lost")? + count("invalid")? + count("out-of-range")?;
        assert_eq!(after.len() + gone, before.len(), "{}: no point goes unaccounted for", format.name());
        assert!(!after.is_empty());
        // The VLP-16 stood in a room: most of its points are nearer than an HDL-32E sees.
        let own_sensor = format != Format::Pcd;
        assert!(!own_sensor || after.len() * 2 > before.len(), "{}: {} points kept", format.name(), after.len());
        assert_eq!((before.ring.is_some(), before.label.is_some()), (after.ring.is_some(), after.label.is_some()));
        let names = |cloud: &PointCloud| cloud.extra.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&before), names(&after), "{}: unknown fields survive", format.name());
    }
    Ok(())
}

#[test]
fn every_kept_point_lies_on_the_ray_of_one_that_was_sent() -> Fact {
    let server = serve()?;
    let before = formats::read(&data("hdl32e.npy"), &Limits::default())?;
    let (_, after) = server.client().convert("", Format::Npy, &before)?;
    let direction = |cloud: &PointCloud, i: usize| {
        let range_m = cloud.range_m(i);
        [cloud.x[i] / range_m, cloud.y[i] / range_m, cloud.z[i] / range_m]
    };
    let mut sent = (0..before.len()).map(|i| (direction(&before, i), before.range_m(i)));
    for i in 0..after.len() {
        let there = direction(&after, i);
        // The order is kept, so one walk through what was sent meets every answer.
        let found = sent.find(|(d, _)| d.iter().zip(&there).all(|(a, b)| (a - b).abs() < 1e-5));
        let (_, range_m) = found.ok_or_else(|| format!("point {i} lies on no ray that was sent"))?;
        assert!((after.range_m(i) / range_m - 1.0).abs() < 0.06, "the model corrects ranges by 5 % at most");
    }
    Ok(())
}

#[test]
fn one_seed_gives_one_answer_whoever_else_is_asking() -> Fact {
    let server = serve()?;
    let bytes = std::fs::read(data("hdl32e.bin"))?;
    let ask = |seed: u64| server.client().scan(&format!("?seed={seed}"), &[], &bytes).map(|answer| answer.body);
    let alone = ask(5)?;
    assert_ne!(alone, ask(6)?, "another seed drops other rays");
    let together: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..6).map(|i| scope.spawn(move || (i % 2, ask(5 + i % 2)))).collect();
        threads.into_iter().map(std::thread::ScopedJoinHandle::join).collect()
    });
    for answer in together {
        let (other, body) = answer.map_err(|_| "a client panicked")?;
        assert_eq!(body? == alone, other == 0);
    }
    Ok(())
}

#[test]
fn labels_and_carlas_tags_ride_along_and_are_heard() -> Fact {
    let server = serve()?;
    let mut cloud = formats::read(&data("hdl32e.npy"), &Limits::default())?;
    // Instance in the upper half, class in the lower: both come back.
    cloud.label =
        Some((0..cloud.len() as u32).map(|i| (i << 16) | if cloud.z[i as usize] < -1.4 { 40 } else { 50 }).collect());
    let (_, labelled) = server.client().convert("?seed=3", Format::Ply, &cloud)?;
    let label = labelled.label.clone().ok_or("labels")?;
    for (i, label) in label.iter().enumerate() {
        assert_eq!(cloud.label.as_ref().map(|l| l[(label >> 16) as usize]), Some(*label));
        assert_eq!(labelled.ring.as_ref().map(|r| r[i]), cloud.ring.as_ref().map(|r| r[(label >> 16) as usize]));
    }
    cloud.label = None;
    let (_, unlabelled) = server.client().convert("?seed=3", Format::Ply, &cloud)?;
    assert!(unlabelled.len() * 2 > cloud.len(), "an unlabelled scan works too");

    let semantic = std::fs::read(data("hdl32e.semantic.bin"))?;
    let media = MediaType::of_format(Format::CarlaSemantic).name;
    let tags =
        |tags: &str| server.client().scan(&format!("?seed=3&tags={tags}"), &[("content-type", media)], &semantic);
    let answer = tags("0.9.14")?;
    assert_eq!(answer.status, 200, "{}", answer.text());
    let tag_and_side = |bytes: &[u8]| -> Vec<(u32, bool)> {
        let number = |b: &[u8]| [b[0], b[1], b[2], b[3]];
        bytes
            .chunks(24)
            .map(|p| (u32::from_le_bytes(number(&p[20..])), f32::from_le_bytes(number(&p[4..])) > 0.0))
            .collect()
    };
    let after = tag_and_side(&answer.body);
    assert!(after.iter().all(|(tag, _)| [1, 3].contains(tag)), "CARLA's own tags come back");
    assert_eq!(tags("0.9.13")?.status, 200);
    Ok(())
}

#[test]
fn a_left_handed_scan_is_the_mirror_image_of_a_right_handed_one() -> Fact {
    let server = serve()?;
    let right = formats::read(&data("hdl32e.bin"), &Limits::default())?;
    let mut left = right.clone();
    left.mirror_y();
    let (_, ros) = server.client().convert("?frame=ros&seed=2", Format::Kitti, &right)?;
    let (_, mut carla) = server.client().convert("?frame=carla&seed=2", Format::Kitti, &left)?;
    carla.mirror_y();
    assert_eq!(ros, carla);
    Ok(())
}

#[test]
fn what_is_wrong_with_a_request_is_said_in_one_json_body() -> Fact {
    let server = RunningServer::start(&models(), &["--default-model", "hdl32e", "--max-body-bytes", "200000"])?;
    let client = server.client();
    let points = vec![1u8; 160];
    let nan: Vec<u8> = [f32::NAN; 400].iter().flat_map(|v| v.to_le_bytes()).collect();
    let cases: Vec<Case> = vec![
        ("", vec![], vec![0; 17], 400),
        ("?seed=minus-one", vec![], points.clone(), 400),
        ("?colour=red", vec![], points.clone(), 400),
        ("?model=no-such", vec![], points.clone(), 404),
        ("?version=99", vec![], points.clone(), 404),
        ("", vec![("accept", "image/jpeg")], points.clone(), 406),
        ("", vec![("content-type", "image/jpeg")], points.clone(), 415),
        ("", vec![], vec![0; 200_016], 413),
        ("", vec![], nan, 422),
        (
            "",
            vec![("content-type", "model/x-ply")],
            b"ply\nformat ascii 1.0\nelement vertex 1000000000000000000000000000000\nend_header\n".to_vec(),
            413,
        ),
    ];
    for (query, headers, body, status) in cases {
        let answer = client.scan(query, &headers, &body)?;
        let said = format!("{query} {headers:?}: {} {}", answer.status, answer.text());
        assert_eq!(answer.status, status, "{said}");
        let json = answer.json()?;
        for field in ["error", "code", "request_id"] {
            assert!(json[field].as_str().is_some_and(|text| !text.is_empty()), "{field} in {said}");
        }
        assert_eq!(json["request_id"].as_str(), answer.header("x-request-id"));
    }
    assert_eq!(client.get("/no-such-place")?.status, 404);
    assert_eq!(client.get("/v1/scan")?.status, 405);
    // And it goes on serving.
    assert_eq!(client.scan("", &[], &std::fs::read(data("hdl32e.bin"))?)?.status, 200);
    Ok(())
}

#[test]
fn damaged_files_of_every_format_are_refused_and_never_fatal() -> Fact {
    let server = serve()?;
    for (format, path) in real_files() {
        let whole = std::fs::read(&path)?;
        let media = MediaType::of_format(format).name;
        // An ascii file that lacks its last digit is none the worse: the cuts stay clear of the end.
        for cut in [1, 7, whole.len() / 3 + 1, whole.len() / 4 * 3 + 1] {
            let answer = server.client().scan("", &[("content-type", media)], &whole[..cut])?;
            assert!([400, 422].contains(&answer.status), "{} cut to {cut}: {}", format.name(), answer.status);
        }
        let answer = server.client().scan("", &[("content-type", media)], &[0xff; 4096])?;
        assert!([400, 413, 422].contains(&answer.status), "{} of ones: {}", format.name(), answer.status);
    }
    assert_eq!(server.client().get("/v2/health/live")?.status, 200);
    Ok(())
}

#[test]
fn nothing_in_nothing_out() -> Fact {
    let server = serve()?;
    let answer = server.client().scan("", &[], &[])?;
    assert_eq!((answer.status, answer.body.len()), (200, 0));
    assert_eq!(answer.count("x-realbeam-points-in")?, 0);
    Ok(())
}

#[test]
fn a_scan_of_another_sensor_is_told_which_rings_to_simulate() -> Fact {
    let server = serve()?;
    let sixteen = std::fs::read(data("vlp16.pcd"))?;
    let answer = server.client().scan("?model=hdl64e", &[("content-type", "application/x-pcd")], &sixteen)?;
    assert_eq!(answer.status, 200, "{}", answer.text());
    let coverage: f64 = answer.header("x-realbeam-grid-coverage").ok_or("coverage")?.parse()?;
    assert!(coverage < 0.5, "{coverage}");
    assert!(answer.header("x-realbeam-warning").is_some_and(|w| w.contains("64")), "{:?}", answer.headers);
    Ok(())
}

#[test]
fn health_and_the_models_cards_are_there_to_be_read() -> Fact {
    let client = serve()?;
    let client = client.client();
    assert_eq!(client.get("/v2/health/live")?.status, 200);
    assert_eq!(client.get("/v2/health/ready")?.status, 200);
    for name in ["hdl64e", "hdl32e", "hdl64e-cls2r"] {
        assert_eq!(client.get(&format!("/v2/models/{name}"))?.json()?["name"], name);
    }
    assert_eq!(client.get("/v2/models/no-such")?.status, 404);
    let info = client.get("/info")?.json()?;
    assert_eq!(info["models"].as_array().map(Vec::len), Some(3));
    Ok(())
}
