//! Checks resampled images against the truth: streets cast along the described rays, and again along those of a moved sensor.

use burn::tensor::{Device, Tensor, TensorData};
use lidar::Sensor;
use scene::street::{StreetConfig, street};
use scene::{Cast, Motion, Pose, cast};

use super::surface::rough;
use super::{Image, Rays, Simulated, library};
use crate::closed_loop::model::Term;

const RINGS: usize = 32;
const COLUMNS: usize = 512;
const STREETS: u64 = 6;

/// A pixel sees a plane if its point is this near to it.
const ON_PLANE_M: f64 = 0.02;

/// A range that is this far off is another surface's.
const WRONG_M: f64 = 0.3;

/// Where a sensor is that is not where it is said to be.
#[derive(Clone, Copy)]
struct Moved {
    effect: &'static str,
    values: &'static [f64],
    up_deg: f64,
    pose: Pose,
    motion: Motion,
}

/// Absolute errors of a ray's range before and after, whether everything around its target is one plane, and whether the image says so.
struct Error {
    before_m: f64,
    after_m: f64,
    on_surface: bool,
    settled: bool,
}

fn sensor(up_deg: f64) -> Sensor {
    let elevations = (0..RINGS).map(|k| 2.0 - 26.9 / 31.0 * k as f64 + up_deg);
    Sensor::from_elevations_deg("truth", elevations, COLUMNS, (1.0, 100.0), 10.0).expect("a sensor")
}

fn image(cast: &Cast, sensor: &Sensor) -> Image {
    let device = Device::flex();
    let tensor = |x: Vec<f32>| Tensor::<3>::from_data(TensorData::new(x, [1, RINGS, COLUMNS]), &device);
    let simulated = Simulated {
        range_m: tensor(cast.image.range_m().to_vec()),
        reflectance: tensor(cast.image.reflectance().to_vec()),
        class: tensor(cast.image.class().iter().map(|c| f32::from(*c)).collect()),
        keep: tensor(vec![1.0; sensor.pixels()]),
        frame: Tensor::zeros([1, 1, 1], &device),
    };
    Image::new(simulated, Rays::new(sensor, &device))
}

fn numbers(x: &Tensor<3>) -> Vec<f64> {
    x.clone().into_data().iter::<f64>().collect()
}

fn still(effect: &'static str, values: &'static [f64]) -> Moved {
    let pose = Pose { position_m: [0.0; 3], ..Pose::default() };
    Moved { effect, values, up_deg: 0.0, pose, motion: Motion::default() }
}

/// What was cast along the described rays, along the true ones, and what resampling makes of the first.
struct Seen {
    simulated: Cast,
    truth: Cast,
    resampled: Image,
}

fn seen(moved: &Moved) -> impl Iterator<Item = Seen> {
    let effect = library().into_iter().find(|e| e.about().name == moved.effect).expect("an effect");
    let term = Term::new(effect, RINGS).at(moved.values);
    let (nominal, bent, moved) = (sensor(0.0), sensor(moved.up_deg), *moved);
    (0..STREETS).map(move |seed| {
        let street = street(seed, &StreetConfig::default());
        let pose = Pose::above_ground(&street, 0.0, 0.0, 0.0).expect("ground");
        let simulated = cast(&street, &nominal, &pose, &Motion::default());
        let shifted = [0, 1, 2].map(|i| pose.position_m[i] + moved.pose.position_m[i]);
        let truth = cast(&street, &bent, &Pose { position_m: shifted, ..moved.pose }, &moved.motion);
        let resampled = term.forward(image(&simulated, &nominal)).resample();
        Seen { simulated, truth, resampled }
    })
}

/// Errors of all rays with a return in both casts.
fn errors(moved: &Moved) -> Vec<Error> {
    let bent = sensor(moved.up_deg);
    let mut errors = Vec::new();
    for Seen { simulated, truth, resampled } in seen(moved) {
        let settled = numbers(&resampled.settled().expect("moved rays").surface);
        let seen = numbers(&resampled.report.range_m);
        for (pixel, after) in seen.into_iter().enumerate() {
            let before = f64::from(simulated.image.range_m()[pixel]);
            let true_m = f64::from(truth.image.range_m()[pixel]);
            if true_m > 0.0 && before > 0.0 && after > 0.0 {
                let on_surface = on_surface(&simulated, &truth, pixel, &bent, moved);
                let [before_m, after_m] = [before, after].map(|range_m| (range_m - true_m).abs());
                errors.push(Error { before_m, after_m, on_surface, settled: settled[pixel] > 0.5 });
            }
        }
    }
    errors
}

/// Whether the four pixels of the simulation around what a moved ray hits lie on the plane that it hits.
fn on_surface(simulated: &Cast, truth: &Cast, pixel: usize, bent: &Sensor, moved: &Moved) -> bool {
    let (ring, column) = (pixel / COLUMNS, pixel % COLUMNS);
    let time_s = scene::cast::column_time_s(bent, column) as f32;
    let [roll, pitch] = [moved.pose.roll_rad, moved.pose.pitch_rad].map(f64::from);
    let yaw = f64::from(moved.pose.yaw_rad + moved.motion.yaw_rate_rad_s * time_s);
    let turn = |[x, y, z]: [f64; 3]| {
        let (y, z) = (y * roll.cos() - z * roll.sin(), y * roll.sin() + z * roll.cos());
        let (x, z) = (x * pitch.cos() + z * pitch.sin(), z * pitch.cos() - x * pitch.sin());
        [x * yaw.cos() - y * yaw.sin(), x * yaw.sin() + y * yaw.cos(), z]
    };
    let normal = turn(truth.normal[pixel].map(f64::from));
    let along = turn(bent.point_m(ring, column, f64::from(truth.image.range_m()[pixel])));
    let from = [0, 1, 2].map(|i| moved.pose.position_m[i] + moved.motion.velocity_m_s[i] * time_s);
    let target = [0, 1, 2].map(|i| along[i] + f64::from(from[i]));
    let elevation_deg = (target[2] / target[0].hypot(target[1])).atan().to_degrees();
    let row = (2.0 - elevation_deg) / (26.9 / 31.0);
    let turned = (180.0 - target[1].atan2(target[0]).to_degrees()) / 360.0 * COLUMNS as f64 - 0.5;
    let nominal = sensor(0.0);
    [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)].iter().all(|(down, right)| {
        let ring = (row.floor() + down).clamp(0.0, RINGS as f64 - 1.0) as usize;
        let column = (turned.floor() + right).rem_euclid(COLUMNS as f64) as usize;
        let range_m = f64::from(simulated.image.range_m()[ring * COLUMNS + column]);
        let point = nominal.point_m(ring, column, range_m);
        let off: f64 = (0..3).map(|i| normal[i] * (point[i] - target[i])).sum();
        range_m > 0.0 && off.abs() < ON_PLANE_M
    })
}

fn mean(x: impl Iterator<Item = f64> + Clone) -> f64 {
    x.clone().sum::<f64>() / x.count().max(1) as f64
}

#[test]
fn what_a_moved_sensor_sees_of_surfaces_is_undone() {
    let radians = |x: f64| x.to_radians() as f32;
    let turned = |moved: Moved, roll: f64, pitch: f64, yaw: f64| {
        let pose = Pose { roll_rad: radians(roll), pitch_rad: radians(pitch), yaw_rad: radians(yaw), ..moved.pose };
        Moved { pose, ..moved }
    };
    let shifted = |moved: Moved, position_m| Moved { pose: Pose { position_m, ..moved.pose }, ..moved };
    // The effect's columns fire half a column after its sweep begins, the cast's first one at once.
    let begun_s = 0.1 * 0.5 / COLUMNS as f32;
    let drive = Motion { velocity_m_s: [10.0, 0.5, 0.0], yaw_rate_rad_s: radians(10.0) };
    let moving = still("rolling_shutter", &[10.0, 0.5, 10.0]);
    let moving = shifted(moving, drive.velocity_m_s.map(|v| v * begun_s));
    let cases = [
        (Moved { up_deg: 0.2, ..still("elevation_offset", &[0.2]) }, 0.965),
        (Moved { up_deg: -0.5, ..still("elevation_offset", &[-0.5]) }, 0.98),
        (turned(still("mount_roll", &[0.3]), 0.3, 0.0, 0.0), 0.96),
        (turned(still("mount_pitch", &[-0.3]), 0.0, -0.3, 0.0), 0.96),
        (turned(still("mount_yaw", &[0.3]), 0.0, 0.0, 0.3), 0.95),
        (shifted(still("mount_height", &[0.05]), [0.0, 0.0, 0.05]), 0.975),
        (Moved { motion: drive, ..turned(moving, 0.0, 0.0, f64::from(begun_s) * 10.0) }, 0.85),
    ];
    for (moved, least) in cases {
        let errors = errors(&moved);
        let on: Vec<&Error> = errors.iter().filter(|e| e.on_surface).collect();
        let (before_m, after_m) = (mean(on.iter().map(|e| e.before_m)), mean(on.iter().map(|e| e.after_m)));
        let mut after: Vec<f64> = on.iter().map(|e| e.after_m).collect();
        after.sort_by(f64::total_cmp);
        let undone = 1.0 - after_m / before_m;
        println!(
            "{} {:?}: {:.1} % on surfaces, {before_m:.4} m before, {after_m:.4} m after, undone {:.1} %, 95 % within {:.4} m; all rays {:.3} m before, {:.3} m after",
            moved.effect,
            moved.values,
            100.0 * on.len() as f64 / errors.len() as f64,
            100.0 * undone,
            after[after.len() * 95 / 100],
            mean(errors.iter().map(|e| e.before_m)),
            mean(errors.iter().map(|e| e.after_m)),
        );
        let settled: Vec<&Error> = errors.iter().filter(|e| e.settled).collect();
        let wrong = settled.iter().filter(|e| e.after_m > WRONG_M).count() as f64 / settled.len() as f64;
        println!(
            "{:.1} % settled, {:.4} % of these wrong",
            100.0 * settled.len() as f64 / errors.len() as f64,
            100.0 * wrong
        );
        assert!(wrong < 0.003, "{}: {wrong} of the settled rays hit something else", moved.effect);
        assert!(undone > least, "{}: {undone}", moved.effect);
        assert!(after[after.len() / 2] < 1e-3 && on.len() * 10 > errors.len() * 7, "{}", moved.effect);
    }
}

#[test]
fn it_is_settled_whether_most_moved_rays_hit_anything() {
    for (effect, values, up_deg) in [("elevation_offset", &[0.2], 0.2), ("elevation_offset", &[-0.5], -0.5)] {
        let (mut rays, mut settled, mut wrong) = (0, 0, 0);
        for Seen { truth, resampled, .. } in seen(&Moved { up_deg, ..still(effect, values) }) {
            let is_settled = numbers(&resampled.settled().expect("moved rays").hit);
            for (pixel, hit) in numbers(&resampled.hit()).into_iter().enumerate() {
                rays += 1;
                if is_settled[pixel] > 0.5 {
                    settled += 1;
                    wrong += usize::from((hit > 0.5) != (truth.image.range_m()[pixel] > 0.0));
                }
            }
        }
        println!("{up_deg}°: of {rays} rays {settled} settled, {wrong} of these wrong");
        assert!(settled * 100 > rays * 95 && wrong * 2000 < settled);
    }
}

#[test]
fn planes_meet_rays_at_the_true_angle() {
    let mut off: Vec<f64> = Vec::new();
    let (mut known, mut all) = (0, 0);
    for seed in 0..STREETS {
        let street = street(seed, &StreetConfig::default());
        let pose = Pose::above_ground(&street, 0.0, 0.0, 0.1).expect("ground");
        let truth = cast(&street, &sensor(0.0), &pose, &Motion::default());
        let surface = image(&truth, &sensor(0.0)).surface;
        let cosines = numbers(&surface.cos_incidence);
        let is_rough = numbers(&rough(&surface.class));
        for (pixel, is_known) in numbers(&surface.known).into_iter().enumerate() {
            if truth.image.range_m()[pixel] > 0.0 && is_rough[pixel] < 0.5 {
                all += 1;
                if is_known > 0.5 {
                    known += 1;
                    off.push((cosines[pixel] - f64::from(truth.incidence_rad[pixel]).cos()).abs());
                }
            }
        }
    }
    off.sort_by(f64::total_cmp);
    let quantile = |q: usize| off[off.len() * q / 100];
    println!(
        "{known} of {all} planes known; cosine off by {:.5}, {:.3} (90 %), {:.3} (95 %)",
        quantile(50),
        quantile(90),
        quantile(95)
    );
    assert!(known * 100 > all * 95 && quantile(50) < 5e-4 && quantile(90) < 0.01 && quantile(95) < 0.06);
}
