//! Speed of the making of sets: `cargo bench -p hidden` prints it for 20 frames of 32 × 512 rays in 10 streets.

use divan::Bencher;
use divan::counter::ItemsCount;
use hidden::{Recipe, frames, typical};
use lidar::Sensor;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

fn main() {
    divan::main();
}

/// A whole set with one defect; items are frames. All threads that rayon finds.
#[divan::bench(args = ["range_offset", "mount_pitch", "blooming"], max_time = 6)]
fn set(bencher: Bencher, name: &str) {
    let elevations_deg = (0..32).map(|i| 2.0 - 26.9 / 31.0 * f64::from(i));
    let Ok(sensor) = Sensor::from_elevations_deg("spinning-32", elevations_deg, 512, (1.0, 100.0), 10.0) else {
        unreachable!("every number above is within what a sensor may have")
    };
    let Some(defect) = typical(name, 1.0, &sensor, &mut ChaCha8Rng::seed_from_u64(1)) else {
        unreachable!("the names above are in the library")
    };
    let recipe = Recipe::new(1, sensor, vec![defect]);
    bencher.counter(ItemsCount::new(recipe.scenes * recipe.frames_per_scene)).bench(|| frames(&recipe));
}
