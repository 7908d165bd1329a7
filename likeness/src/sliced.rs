//! Sliced Wasserstein distance of patches on Laplacian pyramids: whether images have the structures of others, from fine to coarse.
//!
//! Karras et al., "Progressive growing of GANs for improved quality, stability, and variation" (2018), as CLS2R has it; Rabin et al.,
//! "Wasserstein barycenter and its application to texture mixing" (2011).

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::metric::Metric;
use crate::pyramid::{Border, Plane, laplacian};

/// Of the range.
pub const SLICED: Metric = Metric {
    name: "SWD of range patches",
    unit: "standard deviations",
    definition: "sliced Wasserstein-1 distance on Laplacian pyramids of log₂(r + 1) (0 where there is no return), azimuth wrapping round: 3 levels, \
                 128 patches of 7 × 7 a scan and level, 512 directions of length 1, in standard deviations of the real scans' patches of that level; \
                 mean over levels and directions",
};

/// Levels of a pyramid, side of a patch, patches of a scan and level, directions.
const LEVELS: usize = 3;
const SIDE: usize = 7;
const PATCHES: usize = 128;
const DIRECTIONS: usize = 4 * 128;

/// Rings and columns that an image has to have, so that the coarsest level holds a patch.
pub const LEAST: usize = SIDE << (LEVELS - 1);

/// How long a direction is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Length {
    /// 1: a projection of patches has the unit of their values.
    One,
    /// So that its 49 numbers have a standard deviation of 1, as in the code of the papers: seven times as long.
    Deviation,
}

/// What the distance needs of scans; the same for all of them.
#[derive(Clone, Debug)]
pub struct Slicer {
    border: Border,
    seed: u64,
    /// `[direction][49]`.
    directions: Vec<Vec<f32>>,
}

/// One scan's patches.
#[derive(Clone, Debug)]
pub struct Slices {
    levels: Vec<Level>,
}

/// One level's.
#[derive(Clone, Debug)]
struct Level {
    /// Projections of every patch, `[direction][patch]`.
    along: Vec<Vec<f32>>,
    /// Sum and sum of squares of the patches' values.
    moments: [f64; 2],
}

/// What is subtracted from the patches of two sets, and what they are divided by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// The standard deviation of the second set's, for both sets: what is too large or too small shows.
    OfSecond,
    /// Each set's own mean and standard deviation, as in the code of the papers.
    OfEach,
}

impl Slicer {
    /// Directions drawn from a seed, which also chooses the patches of every scan.
    pub fn new(border: Border, length: Length, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let directions = (0..DIRECTIONS).map(|_| direction(&mut rng, length)).collect();
        Self { border, seed, directions }
    }

    /// The patches of a scan, by its number among its set.
    ///
    /// # Panics
    /// If the image is smaller than [`LEAST`] either way.
    pub fn slice(&self, image: Plane, number: usize) -> Slices {
        let least = SIDE << (LEVELS - 1);
        assert!(image.rings() >= least && image.columns >= least, "an image of {least} × {least} or more");
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(number as u64 + 1);
        let levels = laplacian(image, LEVELS, self.border).iter().map(|plane| self.level(plane, &mut rng)).collect();
        Slices { levels }
    }

    fn level(&self, plane: &Plane, rng: &mut impl Rng) -> Level {
        let last = plane.columns - if self.border == Border::Turn { 0 } else { SIDE - 1 };
        let patches: Vec<Vec<f32>> = (0..PATCHES)
            .map(|_| {
                let (ring, column) = (rng.random_range(0..=plane.rings() - SIDE), rng.random_range(0..last));
                let value = |i: usize| plane.at((ring + i / SIDE) as isize, (column + i % SIDE) as isize, self.border);
                (0..SIDE * SIDE).map(value).collect()
            })
            .collect();
        let project = |direction: &Vec<f32>| patches.iter().map(|patch| dot(patch, direction)).collect();
        let values = || patches.iter().flatten().map(|x| f64::from(*x));
        Level {
            along: self.directions.iter().map(project).collect(),
            moments: [values().sum(), values().map(|x| x * x).sum()],
        }
    }

    /// The distance of the scans `a` from the scans `b`: mean over levels and directions.
    pub fn distance(&self, a: &[&Slices], b: &[&Slices], scale: Scale) -> f64 {
        let levels = (0..LEVELS).map(|level| self.distance_at(level, a, b, scale));
        levels.sum::<f64>() / LEVELS as f64
    }

    fn distance_at(&self, level: usize, a: &[&Slices], b: &[&Slices], scale: Scale) -> f64 {
        let of = |set: &[&Slices]| normal(set.iter().map(|scan| scan.levels[level].moments));
        let (own, other) = (of(a), of(b));
        let (own, other) = match scale {
            Scale::OfSecond => ((0.0, other.1), (0.0, other.1)),
            Scale::OfEach => (own, other),
        };
        let along = |set: &[&Slices], k: usize, (mean, deviation): (f64, f64)| {
            let shift = mean * f64::from(self.directions[k].iter().sum::<f32>());
            let all = set.iter().flat_map(|scan| &scan.levels[level].along[k]);
            let mut all: Vec<f64> = all.map(|x| (f64::from(*x) - shift) / deviation).collect();
            all.sort_unstable_by(f64::total_cmp);
            all
        };
        let each = (0..DIRECTIONS).into_par_iter().map(|k| wasserstein_1(&along(a, k, own), &along(b, k, other)));
        // Collected first: a parallel sum would depend on who is ready first.
        each.collect::<Vec<f64>>().iter().sum::<f64>() / DIRECTIONS as f64
    }
}

/// ∫|F⁻¹ − G⁻¹| of two samples, each sorted: the distance of their distribution functions. NaN if either is empty.
pub fn wasserstein_1(a: &[f64], b: &[f64]) -> f64 {
    if a.is_empty() || b.is_empty() {
        return f64::NAN;
    }
    // Shares of the whole in units of 1/(n·m), so that both step at whole numbers.
    let (n, m) = (a.len(), b.len());
    let (mut i, mut j, mut at, mut sum) = (0, 0, 0, 0.0);
    while i < n && j < m {
        let next = ((i + 1) * m).min((j + 1) * n);
        sum += (a[i] - b[j]).abs() * (next - at) as f64;
        at = next;
        i += usize::from((i + 1) * m == next);
        j += usize::from((j + 1) * n == next);
    }
    sum / (n * m) as f64
}

/// Mean and standard deviation of all patches' values.
fn normal(moments: impl ExactSizeIterator<Item = [f64; 2]>) -> (f64, f64) {
    let n = (moments.len() * PATCHES * SIDE * SIDE) as f64;
    let sum = moments.fold([0.0, 0.0], |a, b| [a[0] + b[0], a[1] + b[1]]);
    let mean = sum[0] / n;
    (mean, (sum[1] / n - mean * mean).max(f64::MIN_POSITIVE).sqrt())
}

/// A direction of a uniform distribution.
fn direction(rng: &mut impl Rng, length: Length) -> Vec<f32> {
    // Box and Muller's normal numbers.
    let normal = |rng: &mut dyn Rng| {
        let u: f32 = 1.0 - rng.random_range(0.0..1.0f32);
        (-2.0 * u.ln()).sqrt() * (std::f32::consts::TAU * rng.random_range(0.0..1.0f32)).cos()
    };
    let direction: Vec<f32> = (0..SIDE * SIDE).map(|_| normal(rng)).collect();
    let n = direction.len() as f32;
    let scale = match length {
        Length::One => dot(&direction, &direction).sqrt(),
        Length::Deviation => {
            let mean = direction.iter().sum::<f32>() / n;
            (direction.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / n).sqrt()
        }
    };
    direction.into_iter().map(|x| x / scale).collect()
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    // `scipy.stats.wasserstein_distance([0, 1, 3, 7], [-1, 2, 2.5, 5, 6, 9])`
    #[test]
    fn unequal_samples_are_as_far_apart_as_scipy_says() {
        let found = wasserstein_1(&[0.0, 1.0, 3.0, 7.0], &[-1.0, 2.0, 2.5, 5.0, 6.0, 9.0]);
        assert!((found - 5.0 / 3.0).abs() < 1e-12, "{found}");
        assert!((wasserstein_1(&[1.0, 2.0], &[4.0, 6.0]) - 3.5).abs() < 1e-12);
    }

    fn noise(rings: usize, columns: usize, seed: u64, gain: f32, offset: f32) -> Plane {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let values = (0..rings * columns).map(|_| offset + gain * rng.random_range(-1.0..1.0f32)).collect();
        Plane { columns, values }
    }

    fn slices(slicer: &Slicer, seeds: std::ops::Range<u64>, gain: f32, offset: f32) -> Vec<Slices> {
        seeds.map(|s| slicer.slice(noise(32, 64, s, gain, offset), s as usize)).collect()
    }

    #[test]
    fn what_is_alike_is_near_and_twice_the_contrast_is_a_known_way_off() {
        let slicer = Slicer::new(Border::Turn, Length::One, 1);
        let real = slices(&slicer, 0..8, 1.0, 0.0);
        let distance = |other: &[Slices], scale| {
            slicer.distance(&other.iter().collect::<Vec<_>>(), &real.iter().collect::<Vec<_>>(), scale)
        };
        assert!(distance(&real, Scale::OfSecond).abs() < 1e-9);
        let alike = distance(&slices(&slicer, 8..16, 1.0, 0.0), Scale::OfSecond);
        let contrast = distance(&slices(&slicer, 8..16, 2.0, 0.0), Scale::OfSecond);
        // Projections of noise are nearly normal with a deviation near 1 (as patches' values have): twice as wide is E|x| = 0.8 off. The
        // coarsest level has few different patches, so it is a quarter off itself.
        assert!(alike < 0.2 && (0.6..1.0).contains(&contrast), "{alike} {contrast}");
        // Standardised by themselves, both are the same.
        assert!(distance(&slices(&slicer, 8..16, 2.0, 0.0), Scale::OfEach) < 0.2);
    }

    #[test]
    fn directions_have_their_length() {
        for (length, expected) in [(Length::One, 1.0), (Length::Deviation, 49.0)] {
            let slicer = Slicer::new(Border::Mirror, length, 2);
            let squared: f32 = slicer.directions.iter().map(|d| dot(d, d)).sum::<f32>() / DIRECTIONS as f32;
            // A direction's mean adds a forty-ninth.
            assert!((squared / expected - 1.0).abs() < 0.05, "{squared}");
        }
    }
}
