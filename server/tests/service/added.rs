//! Returns that the sensor reports where the simulation has none.

use lidar::cloud::Values;
use lidar::formats::{self, Format, Limits};
use lidar::{PointCloud, ray_drop};

use crate::support::{Answer, COLUMNS, RINGS, Result, Service, scan};

const PLY: [(&str, &str); 1] = [("content-type", "model/x-ply")];

/// The scan without a block of columns and without every third ray of the others; the pixels of what is left.
fn thinned() -> (PointCloud, Vec<usize>) {
    let there = |i: &u32| !(100..140).contains(&(*i as usize / RINGS)) && !i.is_multiple_of(3);
    let indices: Vec<u32> = (0..(RINGS * COLUMNS) as u32).filter(there).collect();
    let pixel = |i: &u32| (*i as usize % RINGS) * COLUMNS + *i as usize / RINGS;
    (scan().select(&indices), indices.iter().map(pixel).collect())
}

fn decoded(answer: Answer) -> Result<PointCloud> {
    Ok(formats::decode(Format::Ply, &answer.success()?, &Limits::default())?)
}

#[test]
fn a_ray_without_a_return_gets_the_models_own() -> Result {
    let service = Service::start()?;
    let (sent, pixels) = thinned();
    let answer = service.scan("?model=ghosts&version=1&seed=3", &PLY, &formats::encode(Format::Ply, &sent)?)?;
    let count = |name: &str| answer.number(&format!("x-realbeam-points-{name}"));
    assert_eq!((count("in")?, count("kept")?, count("dropped")?), (sent.len() as u64, sent.len() as u64, 0));
    let added = count("added")? as usize;

    let mut draws = vec![0.0; RINGS * COLUMNS];
    ray_drop::uniform(3, 0, COLUMNS, &mut draws);
    let expected: Vec<usize> = (0..draws.len()).filter(|p| !pixels.contains(p) && draws[*p] < 0.25).collect();
    assert_eq!(added, expected.len(), "each ray's own number decides");
    assert!(added > 400);

    let got = decoded(answer)?;
    assert_eq!(got.len(), sent.len() + added);
    let kept: Vec<u32> = (0..sent.len() as u32).collect();
    assert!(got.select(&kept) == sent, "points of the scan come back as they were, and first");
    let (ring, label, time_s) = (
        got.ring.as_deref().ok_or("ring")?,
        got.label.as_deref().ok_or("label")?,
        got.time_s.as_deref().ok_or("time")?,
    );
    for (i, pixel) in (sent.len()..).zip(expected) {
        let (row, column) = (pixel / COLUMNS, pixel % COLUMNS);
        assert!((20.0..30.0).contains(&got.range_m(i)));
        let elevation = (15.0 - 2.0 * row as f32).to_radians();
        let azimuth = std::f32::consts::PI - (column as f32 + 0.5).to_radians();
        let ray = [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()];
        for (at, along) in [got.x[i], got.y[i], got.z[i]].into_iter().zip(ray) {
            // The rounding of 30 m in single precision, through half a dozen operations.
            assert!((at - along * got.range_m(i)).abs() < 2e-5, "point {i}: {at} m");
        }
        assert_eq!((got.intensity[i], ring[i], label[i]), (0.3, row as u16, 0));
        // A column without a point has the time of the nearest that has one: 140 and 99, their middle at 119.5.
        let timed = if (100..120).contains(&column) {
            99
        } else if (120..140).contains(&column) {
            140
        } else {
            column
        };
        assert_eq!(time_s[i], timed as f64 / 3600.0);
    }
    let Values::U16(echo) = &got.extra[0].values else { return Err("echo is u16".into()) };
    assert!(echo[sent.len()..].iter().all(|e| *e == 0));
    Ok(())
}

#[test]
fn without_the_cards_word_the_model_adds_nothing() -> Result {
    let service = Service::start()?;
    let (sent, _) = thinned();
    let answer = service.scan("?model=ghosts&version=2&seed=3", &PLY, &formats::encode(Format::Ply, &sent)?)?;
    assert_eq!(answer.header("x-realbeam-points-added"), "0");
    assert!(decoded(answer)? == sent);
    Ok(())
}

#[test]
fn added_returns_depend_on_the_seed_alone_and_lie_in_the_senders_frame() -> Result {
    let service = Service::start()?;
    let (mut cloud, _) = thinned();
    let ask = |query: &str, cloud: &PointCloud| -> Result<Vec<u8>> {
        service.scan(&format!("?model=ghosts&version=1{query}"), &PLY, &formats::encode(Format::Ply, cloud)?)?.success()
    };
    let answer = ask("&seed=3", &cloud)?;
    assert!(answer == ask("&seed=3", &cloud)? && answer != ask("&seed=4", &cloud)?);
    let mut expected = formats::decode(Format::Ply, &answer, &Limits::default())?;
    expected.mirror_y();
    cloud.mirror_y();
    assert!(formats::decode(Format::Ply, &ask("&seed=3&frame=carla", &cloud)?, &Limits::default())? == expected);
    Ok(())
}

#[test]
fn an_empty_scan_may_come_back_with_returns() -> Result {
    let answer = Service::start()?.scan("?model=ghosts&version=1&noise=median", &PLY, &{
        formats::encode(Format::Ply, &PointCloud::new(1.0))?
    })?;
    let added = answer.number("x-realbeam-points-added")? as usize;
    let got = decoded(answer)?;
    // A quarter of 5760 rays; five standard deviations of 33.
    assert!(got.len() == added && added.abs_diff(1440) < 165, "{added}");
    // Noise of ½: 20 m + 5 m, in single precision.
    assert!((0..got.len()).all(|i| (got.range_m(i) - 25.0).abs() < 1e-5));
    Ok(())
}
