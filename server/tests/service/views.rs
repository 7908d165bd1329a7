//! A scan looked at: as a picture, and point by point.

use lidar::formats::{self, Format};
use proto::ErrorCode;

use ureq::http::{HeaderMap, HeaderName};

use crate::errors::assert_error;
use crate::support::{Result, Service, bin, scan};

#[test]
fn a_picture_shows_both_range_images_and_has_the_headers_of_a_cloud() -> Result {
    let service = Service::start()?;
    let picture = service.scan("?seed=7", &[("accept", "image/png")], &bin()?)?;
    let cloud = service.scan("?seed=7", &[], &bin()?)?;
    assert_eq!(picture.header("content-type"), "image/png");
    let names = |headers: &HeaderMap| {
        let own = |name: &&str| name.starts_with("x-realbeam") || *name == "server-timing";
        headers.keys().map(HeaderName::as_str).filter(own).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(names(&picture.headers), names(&cloud.headers));
    for name in ["in", "kept", "dropped", "lost"] {
        let name = format!("x-realbeam-points-{name}");
        assert_eq!(picture.header(&name), cloud.header(&name));
    }
    let again = service.scan("?seed=7", &[("accept", "text/html;q=0.1, image/*")], &bin()?)?.success()?;
    let other = service.scan("?seed=8", &[("accept", "image/png")], &bin()?)?.success()?;
    let picture = picture.success()?;
    assert!(picture.starts_with(b"\x89PNG\r\n"));
    assert!(picture == again && picture != other);
    Ok(())
}

#[test]
fn every_point_is_listed_before_and_after_as_the_cloud_has_it() -> Result {
    let service = Service::start()?;
    let mut sent = scan();
    // In front of point 10, whose ray it takes.
    (sent.x[5], sent.y[5], sent.z[5]) = (sent.x[10] * 0.5, sent.y[10] * 0.5, sent.z[10] * 0.5);
    sent.ring.as_mut().ok_or("no rings")?[5] = 10;
    sent.x[6] = f32::NAN;
    let body = formats::encode(Format::Ply, &sent)?;
    let ask = |accept: &str| {
        service.scan("?seed=7&frame=carla", &[("content-type", "model/x-ply"), ("accept", accept)], &body)
    };
    let answer = formats::decode(Format::Ply, &ask("model/x-ply")?.success()?, &formats::Limits::default())?;
    let listed = ask("application/json")?;
    assert_eq!(listed.header("content-type"), "application/json");
    let json = listed.json()?;
    assert_eq!(json["points_kept"], listed.number("x-realbeam-points-kept")?);
    assert_eq!((&json["model"], &json["seed"]), (&"passthrough".into(), &7.into()));
    let points = json["points"].as_array().ok_or("no points")?;
    assert_eq!(points.len(), sent.len());
    assert_eq!((&points[10]["fate"], &points[6]["fate"]), (&"unseen".into(), &"unseen".into()));
    assert!(points[6]["before"]["x"].is_null() && points[10]["ring"].is_null());
    assert_eq!(
        (&points[35]["ring"], &points[35]["label"]),
        (&(35 % 16).into(), &sent.label.ok_or("no labels")?[35].into())
    );
    let near = |found: &serde_json::Value, expected: f32| found.as_f64().is_some_and(|f| f as f32 == expected);
    for (i, point) in points.iter().enumerate().filter(|(i, _)| *i != 6) {
        assert!(near(&point["before"]["y"], sent.y[i]), "{point}");
    }
    let kept: Vec<_> = points.iter().filter(|point| point["fate"] == "kept").collect();
    assert_eq!(kept.len(), answer.len());
    for (k, point) in kept.iter().enumerate() {
        let after = &point["after"];
        assert!(near(&after["x"], answer.x[k]) && near(&after["y"], answer.y[k]), "{point}");
        assert!(near(&after["range_m"], answer.range_m(k)) && near(&after["reflectance"], answer.intensity[k]));
    }
    assert!(points.iter().filter(|point| point["fate"] != "kept").all(|point| point["after"].is_null()));

    let records = ask("application/vnd.realbeam.points")?.success()?;
    let numbers: Vec<f32> = records.as_chunks().0.iter().map(|four| f32::from_le_bytes(*four)).collect();
    assert_eq!(numbers.len(), 10 * sent.x.len());
    for (record, point) in numbers.chunks(10).zip(points) {
        let fates = ["kept", "dropped", "unseen", "added"];
        assert_eq!(point["fate"], fates[record[9] as usize]);
        assert_eq!(near(&point["after"]["range_m"], record[4]), record[4] > 0.0);
        assert_eq!(point["column"].as_f64().unwrap_or(-1.0), f64::from(record[7]));
    }
    Ok(())
}

#[test]
fn returns_that_a_model_adds_are_listed_after_the_scans_own() -> Result {
    let service = Service::start()?;
    let every_other: Vec<u32> = (0..scan().len() as u32).filter(|i| i % 2 == 0).collect();
    let body = formats::encode(Format::Kitti, &scan().select(&every_other))?;
    let json = service.scan("?model=ghosts&version=1", &[("accept", "application/json")], &body)?.json()?;
    let points = json["points"].as_array().ok_or("no points")?;
    let added = &points[every_other.len()..];
    assert!(!added.is_empty());
    assert_eq!(json["points_added"], added.len());
    for point in added {
        assert!(point["fate"] == "added" && point["before"].is_null() && point["after"]["range_m"].is_number());
        // Points of even number lie on even rings.
        assert_eq!(point["ring"].as_u64().map(|ring| ring % 2), Some(1), "{point}");
    }
    Ok(())
}

#[test]
fn more_points_than_a_person_reads_are_413() -> Result {
    let answer = Service::start()?.scan("", &[("accept", "application/json")], &vec![0x3f; 16 * 10_001])?;
    assert_error(&answer, 413, ErrorCode::TooManyPoints, "10001 points are more than the 10000 that JSON lists")
}
