//! Rings told by the sender's own counts.

use lidar::PointCloud;
use lidar::formats::{self, Format};
use proto::ErrorCode;

use crate::errors::assert_error;
use crate::support::{Answer, COLUMNS, RINGS, Result, Service, scan};

/// The scan ring after ring, every point 1.2° higher than its ring looks: nearer to the ring above.
fn raised() -> PointCloud {
    let ring_after_ring: Vec<u32> =
        (0..RINGS).flat_map(|ring| (0..COLUMNS).map(move |column| (column * RINGS + ring) as u32)).collect();
    let mut cloud = scan().select(&ring_after_ring);
    cloud.ring = None;
    for i in 0..cloud.len() {
        let along = cloud.x[i].hypot(cloud.y[i]);
        cloud.z[i] = along * ((cloud.z[i] / along).atan() + 1.2f32.to_radians()).tan();
    }
    cloud
}

fn counts(of: &[usize]) -> String {
    of.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

#[test]
fn counted_points_lie_on_the_rings_that_have_them() -> Result {
    let service = Service::start()?;
    // The last ring has half of its points.
    let points = (RINGS - 1) * COLUMNS + COLUMNS / 2;
    let cloud = raised().select(&(0..points as u32).collect::<Vec<_>>());
    let body = formats::encode(Format::Kitti, &cloud)?;
    let ask = |headers: &[(&str, &str)]| service.scan("?version=1", headers, &body);
    let rings = |answer: Answer| -> Result<Vec<Option<u64>>> {
        let json = answer.json()?;
        Ok(json["points"].as_array().ok_or("no points")?.iter().map(|point| point["ring"].as_u64()).collect())
    };
    let counted = counts(&[&[COLUMNS; RINGS - 1][..], &[COLUMNS / 2]].concat());
    let given = rings(ask(&[("accept", "application/json"), ("x-ring-counts", &counted)])?)?;
    let expected = (0..points).map(|i| Some((i / COLUMNS) as u64));
    assert!(given.into_iter().eq(expected.clone()));
    let guessed = rings(ask(&[("accept", "application/json")])?)?;
    assert!(!guessed.into_iter().eq(expected), "elevation alone tells other rings");
    // The scan goes its usual way from there.
    assert!(ask(&[("x-ring-counts", &counted)])?.success()? == body);
    let tensors = [("x-ring-counts", counted.as_str()), ("inference-header-content-length", "0")];
    let answer = service.post("/v2/models/scan/infer?model=passthrough", &tensors, &body)?;
    assert_eq!(answer.status, 200);
    Ok(())
}

#[test]
fn counts_that_cannot_be_are_refused() -> Result {
    let service = Service::start()?;
    let body = formats::encode(Format::Kitti, &raised())?;
    let ask = |counts: &str| service.scan("", &[("x-ring-counts", counts)], &body);
    let right = counts(&[COLUMNS; RINGS]);
    ask(&right)?.success()?;
    let too_few = "x-ring-counts: points are counted for 15 rings, but the sensor has 16";
    assert_error(&ask(&counts(&[COLUMNS; 15]))?, 422, ErrorCode::UnusableScan, too_few)?;
    let many = vec!["0"; 20_000].join(",");
    assert_error(&ask(&many)?, 422, ErrorCode::UnusableScan, "counted for 20000 rings")?;
    let one_more = right.replacen("360", "361", 1);
    let words = "the rings are counted to have 5761 points, but the cloud has 5760";
    assert_error(&ask(&one_more)?, 422, ErrorCode::UnusableScan, words)?;
    let most = counts(&[u32::MAX as usize; RINGS]);
    assert_error(&ask(&most)?, 422, ErrorCode::UnusableScan, "68719476720 points, but")?;
    for wrong in ["-1", "4294967296", "x", ""] {
        let words = format!("x-ring-counts: number 0 is `{wrong}`, expected a whole number of points");
        assert_error(&ask(&right.replacen("360", wrong, 1))?, 400, ErrorCode::BadHeader, &words)?;
    }
    let twice = service.scan("", &[("x-ring-counts", &right), ("x-ring-counts", &right)], &body)?;
    assert_error(&twice, 400, ErrorCode::BadHeader, "x-ring-counts is given twice")
}
