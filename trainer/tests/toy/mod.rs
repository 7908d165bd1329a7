//! Two domains whose difference is known: the one that is real loses most far rays.

use lidar::RangeImage;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use trainer::translation::TranslationConfig;

pub(crate) type Fact = Result<(), Box<dyn std::error::Error>>;

pub(crate) const COLUMNS: usize = 64;
/// Beyond it, the real sensor of these tests loses rays.
pub(crate) const FAR_M: f32 = 20.0;

/// Walls at 4 to 12 m and at 30 to 80 m, eight columns wide each.
pub(crate) fn walls(seed: u64) -> RangeImage {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut image = RangeImage::empty(16, COLUMNS);
    for block in 0..COLUMNS / 8 {
        let range_m = if rng.random_bool(0.5) { rng.random_range(4.0..12.0) } else { rng.random_range(30.0..80.0) };
        for i in (0..16).flat_map(|ring| (0..8).map(move |column| ring * COLUMNS + 8 * block + column)) {
            image.set(i, range_m + rng.random_range(-0.1..0.1), 0.5, 13);
        }
    }
    image
}

/// What the real sensor of these tests sees of walls: it loses six of ten far rays, and no near one.
pub(crate) fn measured(seed: u64) -> RangeImage {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut image = walls(seed);
    for i in 0..16 * COLUMNS {
        if image.range_m()[i] > FAR_M && rng.random_bool(0.6) {
            image.remove(i);
        }
    }
    image
}

/// A config of a tiny network; `schedule` is what its table says beside the size of batches.
pub(crate) fn config(method: &str, schedule: &str) -> Result<TranslationConfig, Box<dyn std::error::Error>> {
    let data = |domain: &str, part: &str| {
        format!(
            "[[{domain}.{part}]]\npath = \"{domain}/{part}\"\ncolumns = {COLUMNS}\nsource = \"made up\"\nlicence = \"MIT\"\n"
        )
    };
    let mut text = format!(
        "name = \"toy\"\nsummary = \"A toy\"\nlicence = \"MIT\"\nsensor = \"vlp16\"\ncolumns = {COLUMNS}\nmethod = \"{method}\"\nseed = 3\n\
         [generator]\nwidth = 8\nblocks = 2\noutput = \"correction\"\n[discriminator]\nwidth = 8\nhalvings = 2\n\
         [losses]\npatches = 64\ncontrast = 0.03\ncontrast_identity = 0.03\ncycle = 1.0\ngeometry = 2.0\nidentity = 0.5\n[unet]\nchannels = [16, 16, 16, 16]\n\
         [schedule]\nbatch = 5\ncrop_columns = {COLUMNS}\nlearning_rate = 1e-3\naverage = 0.9\n{schedule}\n"
    );
    for domain in ["simulated", "real"] {
        for part in ["train", "validate", "test"] {
            text += &data(domain, part);
        }
    }
    Ok(TranslationConfig::from_table(toml::from_str(&text)?)?)
}
