//! Speed of the ray caster: `cargo bench -p scene` prints it for one scan of an HDL-64E (64 × 2048 rays).

use divan::Bencher;
use divan::counter::ItemsCount;
use lidar::Sensor;
use scene::street::{StreetConfig, mesh, street};
use scene::{Motion, Pose, Scene, cast};

fn main() {
    divan::main();
}

/// One sweep in one of three streets; items are rays. All threads that rayon finds.
#[divan::bench(args = [1, 2, 3], max_time = 4)]
fn sweep(bencher: Bencher, seed: u64) {
    let scene = street(seed, &StreetConfig::default());
    let Ok(sensor) = Sensor::builtin("hdl64e") else { unreachable!("the sensor is built in") };
    bencher
        .counter(ItemsCount::new(sensor.pixels()))
        .bench(|| cast(&scene, &sensor, &Pose::default(), &Motion::default()));
}

/// Making up a street; items are triangles.
#[divan::bench(args = [1, 2, 3], max_time = 4)]
fn make_up(bencher: Bencher, seed: u64) {
    let triangles = mesh(seed, &StreetConfig::default()).len();
    bencher.counter(ItemsCount::new(triangles)).bench(|| mesh(seed, &StreetConfig::default()));
}

/// Building the tree over a street; items are triangles.
#[divan::bench(args = [1, 2, 3], max_time = 4)]
fn build_tree(bencher: Bencher, seed: u64) {
    let mesh = mesh(seed, &StreetConfig::default());
    bencher.counter(ItemsCount::new(mesh.len())).with_inputs(|| mesh.clone()).bench_values(Scene::new);
}
