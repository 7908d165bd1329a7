//! Facts about made-up streets.

use std::collections::BTreeSet;

use lidar::Sensor;
use lidar::label::{CLASS_NAMES, CLASSES, class_of};
use scene::street::{StreetConfig, mesh, street};
use scene::{Motion, Pose, cast};

type Outcome = Result<(), Box<dyn std::error::Error>>;

#[test]
fn the_same_seed_is_the_same_street_and_another_seed_another_one() -> Outcome {
    let config = StreetConfig::default();
    assert_eq!(mesh(7, &config), mesh(7, &config));
    let sensor = Sensor::builtin("vlp16")?;
    let scan = |seed| cast(&street(seed, &config), &sensor, &Pose::default(), &Motion::default());
    assert_ne!(scan(7).image, scan(8).image);
    Ok(())
}

#[test]
fn the_number_of_threads_changes_nothing() -> Outcome {
    let sensor = Sensor::builtin("hdl32e")?;
    let scan = |threads: usize| -> Result<_, rayon::ThreadPoolBuildError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        Ok(pool.install(|| cast(&street(4, &StreetConfig::default()), &sensor, &Pose::default(), &Motion::default())))
    };
    assert!(scan(1)? == scan(5)?);
    Ok(())
}

#[test]
fn every_class_is_seen_in_some_street() -> Outcome {
    let sensor = Sensor::builtin("hdl64e")?;
    let mut seen = BTreeSet::new();
    let mut seeds = 0;
    while seen.len() < CLASSES && seeds < 24 {
        seeds += 1;
        let scan = cast(&street(seeds, &StreetConfig::default()), &sensor, &Pose::default(), &Motion::default());
        seen.extend(scan.cloud.label.ok_or("labels")?.iter().map(|label| class_of(*label)));
    }
    let missing: Vec<&str> = (0..CLASSES).filter(|c| !seen.contains(&(*c as u8))).map(|c| CLASS_NAMES[c]).collect();
    assert!(missing.is_empty(), "not in {seeds} streets: {missing:?}");
    Ok(())
}

#[test]
fn nothing_is_near_the_sensor_and_the_road_is_below_it() -> Outcome {
    let elevations = (0..178).map(|e| 88.5 - f64::from(e));
    let sensor = Sensor::from_elevations_deg("all around", elevations, 1440, (0.0, 200.0), 10.0)?;
    for seed in 0..20 {
        let scan = cast(&street(seed, &StreetConfig::default()), &sensor, &Pose::default(), &Motion::default());
        let ranges = scan.image.range_m().iter().filter(|r| **r > 0.0);
        let nearest_m = ranges.fold(f32::INFINITY, |a, b| a.min(*b));
        assert!(nearest_m > 1.5, "seed {seed}: something is {nearest_m} m away");
        let below = sensor.pixels() - 1;
        assert!((scan.image.range_m()[below] - 1.73).abs() < 0.05 && scan.image.class()[below] == 9, "seed {seed}");
    }
    Ok(())
}

#[test]
fn a_street_is_long_large_and_made_of_possible_materials() {
    for seed in 0..6 {
        let mesh = mesh(seed, &StreetConfig::default());
        let [low, high] = mesh.bounds_m();
        assert!(low[0] < -140.0 && high[0] > 140.0, "seed {seed}: {low:?} to {high:?}");
        assert!((100_000..600_000).contains(&mesh.len()), "seed {seed}: {} triangles", mesh.len());
        for i in 0..mesh.len() {
            let material = mesh.material(i);
            assert!(material.reflectance > 0.0 && material.reflectance <= 1.0, "{material:?}");
            assert!(!material.retro || material.reflectance >= 0.9, "{material:?}");
        }
    }
}

#[test]
fn paint_is_brighter_than_the_road_and_signs_send_light_back() {
    let mesh = mesh(1, &StreetConfig::default());
    let of = |label: u32| (0..mesh.len()).map(|i| mesh.material(i)).filter(move |m| m.label & 0xffff == label);
    let brightest_road = of(40).map(|m| m.reflectance).fold(0.0, f32::max);
    let darkest_paint = of(60).map(|m| m.reflectance).fold(1.0, f32::min);
    assert!(darkest_paint > 1.5 * brightest_road, "{darkest_paint} {brightest_road}");
    assert!(of(81).any(|m| m.retro));
}

#[test]
fn the_ground_has_no_holes() -> Outcome {
    // Seen from high above, where only the land's rim is farther than the rays of these elevations reach.
    let elevations = (0..120).map(|e| -60.0 - 0.24 * f64::from(e));
    let sensor = Sensor::from_elevations_deg("from above", elevations, 2048, (0.0, 500.0), 10.0)?;
    for seed in 0..4 {
        let pose = Pose { position_m: [0.0, 0.0, 60.0], ..Pose::default() };
        let scan = cast(&street(seed, &StreetConfig::default()), &sensor, &pose, &Motion::default());
        assert_eq!(scan.cloud.len(), sensor.pixels(), "seed {seed}");
    }
    Ok(())
}

#[test]
fn an_empty_configuration_is_the_default_and_a_wrong_word_is_refused() -> Outcome {
    assert_eq!(toml::from_str::<StreetConfig>("")?, StreetConfig::default());
    let error = toml::from_str::<StreetConfig>("trees = 4").err().map(|e| e.to_string()).unwrap_or_default();
    assert!(error.contains("trees_per_100_m"), "{error}");
    let back: StreetConfig = toml::from_str(&toml::to_string(&StreetConfig::default())?)?;
    assert_eq!(back, StreetConfig::default());
    Ok(())
}

#[test]
fn absurd_configurations_still_give_a_street() {
    for value in [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e30] {
        let span = [value, value];
        let config = StreetConfig {
            reach_m: if value > 1.0 { 60.0 } else { value },
            lane_width_m: span,
            curvature_per_m: span,
            slope: span,
            roughness_m: span,
            side_streets_per_100_m: span,
            built_share: span,
            parked_share: span,
            vehicles_per_100_m: span,
            people_per_100_m: span,
            trees_per_100_m: span,
        };
        assert!(mesh(1, &config).len() > 1000, "{value}");
    }
}
