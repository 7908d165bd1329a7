//! Facts about whole sets: noise as stated, defects that change what they say and nothing else, files that come back.

use hidden::{
    Channel, Defect, LIBRARY, Noise, Range, Recipe, Returns, UNKNOWN, frame, frames, small_sensor, typical, write,
};
use lidar::formats::{Limits, read};
use lidar::{Projector, RangeImage, Sensor};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use scene::Pose;
use scene::street::{StreetConfig, street};

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn sensor() -> Result<Sensor, lidar::sensor::SensorError> {
    let elevations_deg = (0..32).map(|i| 2.0 - 26.0 / 31.0 * f64::from(i));
    Sensor::from_elevations_deg("spinning-32", elevations_deg, 256, (1.0, 100.0), 10.0)
}

/// Four frames in two streets.
fn recipe(hidden: Vec<Defect>) -> Result<Recipe, lidar::sensor::SensorError> {
    Ok(Recipe { scenes: 2, ..Recipe::new(5, sensor()?, hidden) })
}

fn defect(name: &str) -> Result<Defect, Box<dyn std::error::Error>> {
    typical(name, 1.0, &sensor()?, &mut ChaCha8Rng::seed_from_u64(11)).ok_or_else(|| name.into())
}

/// Range and reflectance of each pixel of the measured halves; `None` without a return.
fn measured(recipe: &Recipe) -> Vec<Option<[f32; 2]>> {
    frames(recipe).iter().flat_map(|frame| pixels(&frame.measured)).collect()
}

fn pixels(image: &RangeImage) -> Vec<Option<[f32; 2]>> {
    let both = image.range_m().iter().zip(image.reflectance());
    both.map(|(range_m, reflectance)| (*range_m > 0.0).then_some([*range_m, *reflectance])).collect()
}

#[test]
fn without_defects_the_measured_half_is_the_simulated_one_with_the_stated_noise_and_drop() -> Outcome {
    let noise = Noise { range_sigma_m: 0.03, reflectance_sigma: 0.01, drop: 0.08 };
    let recipe = Recipe { noise, ..recipe(Vec::new())? };
    let (mut errors, mut simulated_returns) = (Vec::new(), 0);
    for frame in frames(&recipe) {
        assert!(frame.measured.class().iter().all(|class| *class == 0), "no sensor measures classes");
        assert!(frame.simulated.class().contains(&9), "a street has a road");
        for (simulated, measured) in pixels(&frame.simulated).into_iter().zip(pixels(&frame.measured)) {
            simulated_returns += usize::from(simulated.is_some());
            match (simulated, measured) {
                (Some(simulated), Some(measured)) => {
                    errors.push([measured[0] - simulated[0], measured[1] - simulated[1]].map(f64::from));
                }
                (None, Some(_)) => return Err("a return where nothing is".into()),
                _ => {}
            }
        }
    }
    let n = errors.len() as f64;
    // Five standard errors: σ/√n of a mean, σ/√(2n) of a standard deviation, √(p(1 − p)/n) of a share.
    assert!(n > 2e4, "{n}");
    for (k, sigma) in [noise.range_sigma_m, noise.reflectance_sigma].into_iter().enumerate() {
        let mean = errors.iter().map(|e| e[k]).sum::<f64>() / n;
        let deviation = (errors.iter().map(|e| (e[k] - mean).powi(2)).sum::<f64>() / n).sqrt();
        assert!(mean.abs() < 5.0 * sigma / n.sqrt(), "channel {k}: mean {mean}");
        assert!((deviation - sigma).abs() < 5.0 * sigma / (2.0 * n).sqrt(), "channel {k}: σ {deviation}");
    }
    let dropped = 1.0 - n / simulated_returns as f64;
    assert!((dropped - noise.drop).abs() < 5.0 * (0.08 * 0.92 / n).sqrt(), "{dropped}");
    Ok(())
}

#[test]
fn a_defect_changes_its_channels_and_no_other() -> Outcome {
    let street = street(3, &StreetConfig::default());
    let poses = (0..3).map(|k| Pose::above_ground(&street, 3.0 * k as f32, 0.0, 0.1)).collect::<Option<Vec<_>>>();
    let poses = poses.ok_or("a street has ground")?;
    let drive = |hidden: Vec<Defect>| -> Result<Vec<_>, lidar::sensor::SensorError> {
        let recipe = recipe(hidden)?;
        let halves = poses.iter().enumerate().map(|(number, pose)| frame(&recipe, &street, pose, number));
        Ok(halves.flat_map(|(_, measured)| pixels(&measured)).collect())
    };
    let plain = drive(Vec::new())?;
    let returns = plain.iter().flatten().count();
    for name in LIBRARY.iter().chain(UNKNOWN) {
        let defect = defect(name)?;
        let changes = |channel| defect.channels().contains(&channel);
        let (mut range, mut reflectance, mut missing, mut extra) = (0, 0, 0, 0);
        for (before, after) in plain.iter().zip(drive(vec![defect.clone()])?) {
            match (before, after) {
                (Some(before), Some(after)) => {
                    range += usize::from(before[0] != after[0]);
                    reflectance += usize::from(before[1] != after[1]);
                }
                (Some(_), None) => missing += 1,
                (None, Some(_)) => extra += 1,
                (None, None) => {}
            }
        }
        // An error of range takes what is next to a range limit over it, and noise takes a particle; under 1 in 1000 is there.
        let moves = changes(Channel::Range) || changes(Channel::Extra);
        let at_limits = if moves { returns / 1000 } else { 0 };
        let anything = changes(Channel::Geometry);
        if changes(Channel::Extra) {
            let changed = range.max(reflectance) + extra;
            assert!(changed > 0 && changed < returns / 8, "{name}: {changed} of {returns}");
        } else if !anything {
            assert!(changes(Channel::Range) || range == 0, "{name}: {range} ranges");
            assert!(changes(Channel::Reflectance) || reflectance == 0, "{name}: {reflectance} reflectances");
            assert!(extra <= at_limits, "{name}: {extra} extra");
        }
        assert!(changes(Channel::Missing) || anything || missing <= at_limits, "{name}: {missing} missing");
        assert!(!(changes(Channel::Range) || anything) || range > returns / 100, "{name}: {range} ranges");
        assert!(!changes(Channel::Reflectance) || reflectance > returns / 100, "{name}: {reflectance} reflectances");
        assert!(!changes(Channel::Missing) || missing > returns / 200, "{name}: {missing} missing");
    }
    Ok(())
}

#[test]
fn the_order_in_which_defects_are_listed_changes_nothing() -> Outcome {
    // Neither of these two draws a random number, so the very bits must agree.
    let (gain, dark) = (defect("ring_gain")?, defect("reflectance_falloff")?);
    let one = measured(&recipe(vec![gain.clone(), dark.clone()])?);
    assert!(one == measured(&recipe(vec![dark, gain])?));
    Ok(())
}

#[test]
fn quantised_ranges_are_multiples_of_the_step() -> Outcome {
    let recipe = recipe(vec![Range::Quantisation { step_m: 0.25 }.into(), defect("range_scale")?])?;
    // Multiples of a quarter are exact in binary.
    assert!(measured(&recipe).iter().flatten().all(|[range_m, _]| (range_m / 0.25).fract() == 0.0));
    Ok(())
}

#[test]
fn nothing_is_reported_outside_the_range_limits() -> Outcome {
    let recipe = recipe(vec![Returns::RangeLimits { minimum_m: 6.0, maximum_m: 30.0 }.into()])?;
    assert!(measured(&recipe).iter().flatten().all(|[range_m, _]| (6.0..=30.0).contains(range_m)));
    Ok(())
}

#[test]
fn snow_is_seen_before_what_is_behind_it_and_as_often_as_stated() -> Outcome {
    let (density_per_m, reach_m) = (0.02, 6.0);
    let snow = Returns::Precipitation { probability_per_m: density_per_m, reach_m };
    let quiet = Noise { range_sigma_m: 0.0, reflectance_sigma: 0.0, drop: 0.0 };
    let recipe = Recipe { noise: quiet, ..recipe(vec![snow.into()])? };
    let (mut seen, mut expected, mut variance) = (0.0, 0.0, 0.0_f64);
    for frame in frames(&recipe) {
        for (simulated, measured) in pixels(&frame.simulated).into_iter().zip(pixels(&frame.measured)) {
            let end_m = simulated.map_or(100.0, |[range_m, _]| f64::from(range_m));
            let met = density_per_m * reach_m * ((-1.0 / reach_m).exp() - (-end_m / reach_m).exp());
            let share = 1.0 - (-met).exp();
            (expected, variance) = (expected + share, variance + share * (1.0 - share));
            if simulated != measured {
                seen += 1.0;
                let [range_m, reflectance] = measured.ok_or("snow takes no return away")?;
                assert!(f64::from(range_m) <= end_m && reflectance < 0.061);
            }
        }
    }
    // Rays are independent: five standard deviations.
    assert!((seen - expected).abs() < 5.0 * variance.sqrt(), "{seen} flakes, {expected} expected");
    Ok(())
}

#[test]
fn the_number_of_threads_changes_nothing() -> Outcome {
    let recipe = recipe(LIBRARY.iter().map(|name| defect(name)).collect::<Result<_, _>>()?)?;
    let made = |threads: usize| -> Result<_, rayon::ThreadPoolBuildError> {
        Ok(rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(|| frames(&recipe)))
    };
    assert!(made(1)? == made(3)?);
    assert!(frames(&Recipe { seed: recipe.seed + 1, ..recipe.clone() }) != frames(&recipe));
    Ok(())
}

#[test]
fn a_written_set_reads_back_as_the_frames_and_a_second_time_as_the_same_bytes() -> Outcome {
    let home = tempfile::tempdir()?;
    let recipe = Recipe { sensor: small_sensor(3), ..recipe(vec![defect("random_returns")?])? };
    let [one, two] = ["one", "two"].map(|name| home.path().join(name));
    write(&recipe, &one)?;
    write(&recipe, &two)?;
    assert!(write(&recipe, &one).is_err_and(|e| e.to_string().contains("exists already")));
    assert_eq!(std::fs::read_dir(home.path())?.count(), 2, "nothing is left beside the sets");

    let sensor = Sensor::from_toml(&std::fs::read_to_string(one.join("sensor.toml"))?)?;
    assert_eq!(std::fs::read_to_string(one.join("scenes.txt"))?, "street-00\nstreet-00\nstreet-01\nstreet-01\n");
    let mut projector = Projector::new(&sensor);
    for (number, frame) in frames(&recipe).iter().enumerate() {
        for (half, image) in [("sim", &frame.simulated), ("measured", &frame.measured)] {
            let file = format!("{half}/{number:06}.ply");
            assert!(std::fs::read(one.join(&file))? == std::fs::read(two.join(&file))?, "{file}");
            let cloud = read(&one.join(&file), &Limits::default())?;
            assert_eq!(cloud.label.is_some(), half == "sim");
            let back = projector.project(&cloud)?.image;
            assert_eq!(back.class(), image.class(), "{file}");
            for (back, made) in pixels(&back).into_iter().zip(pixels(image)) {
                match (back, made) {
                    // The coordinates of a point are rounded to f32: 6·10⁻⁸ of it each.
                    (Some(back), Some(made)) => {
                        assert!((back[0] - made[0]).abs() < 3e-7 * made[0] && back[1] == made[1], "{file}");
                    }
                    (None, None) => {}
                    _ => return Err(format!("{file}: a return came or went").into()),
                }
            }
        }
    }
    Ok(())
}
