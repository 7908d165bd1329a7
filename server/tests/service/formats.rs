//! Every format goes in and comes out with its fields.

use lidar::PointCloud;
use lidar::cloud::Values;
use lidar::formats::{self, Format, Limits};
use proto::media::MEDIA_TYPES;

use crate::support::{Result, Service, bin, scan};

/// LAS holds coordinates to 0.1 mm, so two roundings may differ by one step; all other formats hold what they are given.
fn tolerance_m(format: Format) -> f32 {
    if matches!(format, Format::Las | Format::Laz) { 1.5e-4 } else { 0.0 }
}

fn assert_same_scan(found: &PointCloud, expected: &PointCloud, tolerance_m: f32, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let near = |a: &[f32], b: &[f32], tolerance: f32| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance);
    for (a, b) in [(&found.x, &expected.x), (&found.y, &expected.y), (&found.z, &expected.z)] {
        assert!(near(a, b, tolerance_m), "{what}: coordinates");
    }
    let reflectance = |cloud: &PointCloud| cloud.intensity.iter().map(|i| i / cloud.full_scale).collect::<Vec<_>>();
    // Half a step of the coarsest scale there is, 8 bits.
    assert!(near(&reflectance(found), &reflectance(expected), 0.5 / 255.0 + 1e-6), "{what}: reflectance");
}

#[test]
fn a_model_that_changes_nothing_gives_every_format_back_with_all_its_fields() -> Result {
    let service = Service::start()?;
    for media in MEDIA_TYPES {
        let body = formats::encode(media.format, &scan())?;
        let answer = service.scan("?version=1", &[("content-type", media.name)], &body)?;
        assert_eq!(answer.header("content-type"), media.name);
        let (sent, got) = (
            formats::decode(media.format, &body, &Limits::default())?,
            formats::decode(media.format, &answer.success()?, &Limits::default())?,
        );
        assert_same_scan(&got, &sent, tolerance_m(media.format), media.name);
        assert_eq!(got.ring, sent.ring, "{}", media.name);
        assert_eq!(got.label, sent.label, "{}", media.name);
        assert_eq!(got.time_s, sent.time_s, "{}", media.name);
        assert_eq!(got.extra, sent.extra, "{}", media.name);
    }
    Ok(())
}

#[test]
fn four_floats_come_back_bit_for_bit_from_a_model_that_changes_nothing() -> Result {
    let answer = Service::start()?.scan("?version=1", &[], &bin()?)?.success()?;
    assert!(answer == bin()?);
    Ok(())
}

#[test]
fn accept_chooses_the_format_of_the_answer_and_labels_ride_along() -> Result {
    let service = Service::start()?;
    let body = formats::encode(Format::Ply, &scan())?;
    for media in MEDIA_TYPES {
        let headers = [("content-type", "model/x-ply"), ("accept", media.name)];
        let answer = service.scan("?version=1", &headers, &body)?;
        assert_eq!(answer.header("content-type"), media.name);
        let got = formats::decode(media.format, &answer.success()?, &Limits::default())?;
        let mut expected = scan();
        if media.format == Format::CarlaSemantic {
            // It has no intensity.
            expected.intensity.fill(0.0);
        }
        assert_same_scan(&got, &expected, tolerance_m(media.format), media.name);
        let class =
            |cloud: &PointCloud| cloud.label.clone().map(|l| l.into_iter().map(|l| l & 0xffff).collect::<Vec<_>>());
        if !matches!(media.format, Format::Kitti | Format::NuScenes) {
            assert_eq!(class(&got), class(&expected), "{}", media.name);
        }
    }
    Ok(())
}

#[test]
fn the_class_of_a_point_reaches_the_model() -> Result {
    // The stand-in keeps 0.9 of the unlabelled rays, and every labelled one.
    let body = formats::encode(Format::Pcd, &scan())?;
    let answer = Service::start()?.scan("", &[("content-type", "application/x-pcd")], &body)?.success()?;
    let got = formats::decode(Format::Pcd, &answer, &Limits::default())?;
    let labelled = |cloud: &PointCloud| cloud.label.as_ref().map_or(0, |l| l.iter().filter(|l| **l != 0).count());
    assert_eq!(labelled(&got), labelled(&scan()));
    let (sent, kept) = (scan().len() - labelled(&scan()), got.len() - labelled(&got));
    // Standard deviation √(0.9·0.1/3840) = 0.005; five of them.
    assert!((kept as f64 / sent as f64 - 0.9).abs() < 0.025, "{kept} of {sent}");
    Ok(())
}

#[test]
fn tags_are_read_by_the_table_that_the_query_names() -> Result {
    // Tag 11 is a wall in the old table and the sky, which is no class, in the new one; the stand-in keeps all labelled rays.
    let mut cloud = scan();
    cloud.label = None;
    cloud.extra = vec![lidar::cloud::Column { name: "ObjTag".into(), values: Values::U32(vec![11; cloud.len()]) }];
    let body = formats::encode(Format::CarlaSemantic, &cloud)?;
    let service = Service::start()?;
    let dropped = |query: &str| -> Result<u64> {
        let headers = [("content-type", "application/vnd.carla.semantic-lidar")];
        service.scan(query, &headers, &body)?.number("x-realbeam-points-dropped")
    };
    assert_eq!(dropped("?tags=0.9.13")?, 0);
    assert!(dropped("?tags=0.9.14")? > 0);
    assert_eq!(dropped("")?, dropped("?tags=0.9.14")?);
    Ok(())
}

#[test]
fn a_left_handed_scan_is_treated_as_its_mirror_image() -> Result {
    let service = Service::start()?;
    let mut mirrored = scan();
    mirrored.mirror_y();
    let (ours, carlas) = (bin()?, formats::encode(Format::Kitti, &mirrored)?);
    let expected = service.scan("", &[], &ours)?.success()?;
    let mirror = |bytes: &[u8]| -> Result<Vec<u8>> {
        let mut cloud = formats::decode(Format::Kitti, bytes, &Limits::default())?;
        cloud.mirror_y();
        Ok(formats::encode(Format::Kitti, &cloud)?)
    };
    let carla = [("content-type", "application/vnd.carla.lidar")];
    assert!(mirror(&service.scan("?frame=carla", &[], &carlas)?.success()?)? == expected);
    assert!(mirror(&service.scan("", &carla, &carlas)?.success()?)? == expected, "the type implies the frame");
    assert!(service.scan("?frame=ros", &carla, &ours)?.success()? == expected, "the query overrules the type");
    Ok(())
}

#[test]
fn zero_points_in_are_zero_points_out_in_every_format() -> Result {
    let service = Service::start()?;
    for media in MEDIA_TYPES {
        let body = formats::encode(media.format, &PointCloud::new(1.0))?;
        let answer = service.scan("", &[("content-type", media.name)], &body)?;
        assert_eq!(answer.number("x-realbeam-points-in")?, 0, "{}", media.name);
        assert_eq!(answer.header("x-realbeam-warning"), "", "{}", media.name);
        let got = formats::decode(media.format, &answer.success()?, &Limits::default())?;
        assert!(got.is_empty(), "{}", media.name);
    }
    Ok(())
}
