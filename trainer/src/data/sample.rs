//! Batches: cut-outs of real scans, made to look simulated, beside what the sensor measured.

use burn::tensor::{Device, Tensor, TensorData};
use lidar::RangeImage;
use lidar::label::CLASSES;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::holes::{self, Pixel};
use super::scans::{Scans, cut_columns};

/// Standard deviation of the jitter on every input range, in metres: it hides what filling left behind.
const JITTER_M: f32 = 0.01;

/// Share of the samples whose labels are blanked, so that a scan without labels works too.
const UNLABELLED_SHARE: f64 = 0.5;

/// CARLA's default `atmosphere_attenuation_rate`, per metre: its lidar reports e^(−0.004 r) whatever the ray hit.
pub const CARLA_ATTENUATION: f32 = 0.004;

/// Network input and targets, each `[batch, channel, ring, column]`.
#[derive(Clone, Debug)]
pub struct Batch {
    /// Range (m), reflectance, class: 3 channels.
    pub scan: Tensor<4>,
    /// ln(measured range + 1).
    pub log_range: Tensor<4>,
    /// Measured reflectance.
    pub reflectance: Tensor<4>,
    /// 1 where the sensor reported the ray.
    pub keep: Tensor<4>,
    /// Rays that the pixel stands for in the loss of the keep mask.
    pub keep_weight: Tensor<4>,
    /// 1 where range and reflectance were measured.
    pub measured: Tensor<4>,
}

/// One cut-out before it becomes tensors; each channel `[ring, column]`.
#[derive(Clone, Debug)]
pub struct Sample {
    /// What a simulator would have given.
    pub simulated: RangeImage,
    /// What the sensor measured.
    pub real: RangeImage,
    /// What became of each pixel.
    pub pixel: Vec<Pixel>,
    /// See [`holes::weights`]; all zero where drops were not observed.
    pub keep_weight: Vec<f32>,
}

/// Real scans of one kind.
#[derive(Clone, Debug)]
pub struct Source {
    /// Range images with as many rings.
    pub images: Vec<RangeImage>,
    /// See [`DataConfig::drops_observed`](crate::config::DataConfig::drops_observed).
    pub drops_observed: bool,
}

impl From<Scans> for Source {
    fn from(scans: Scans) -> Self {
        Self { images: scans.images, drops_observed: scans.drops_observed }
    }
}

/// Draws batches; the same step gives the same batch, whenever it is drawn.
#[derive(Clone, Debug)]
pub struct Sampler {
    sources: Vec<Source>,
    seed: u64,
    batch: usize,
    crop_columns: usize,
}

/// What a simulator says about reflectance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SimulatedReflectance {
    /// e^(−rate · range), as CARLA does.
    Attenuation(f32),
    /// The same everywhere.
    Constant(f32),
    /// Coarse albedo: the measured reflectance averaged along the ring over this many columns on either side, times a gain.
    Albedo(usize, f32),
    /// Whatever belongs to a class has one reflectance, as in simulators that know materials.
    ByClass([f32; CLASSES]),
}

impl Sampler {
    /// A sampler over these scans.
    pub fn new(sources: Vec<Source>, seed: u64, batch: usize, crop_columns: usize) -> Self {
        Self { sources, seed, batch, crop_columns }
    }

    /// The batch of a step.
    pub fn batch(&self, step: usize, device: &Device) -> Batch {
        let samples: Vec<Sample> = (0..self.batch)
            .map(|k| {
                let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
                rng.set_stream((step * self.batch + k) as u64 + 1);
                self.draw(&mut rng)
            })
            .collect();
        Batch::new(&samples, device)
    }

    fn draw(&self, rng: &mut impl Rng) -> Sample {
        let total: usize = self.sources.iter().map(|s| s.images.len()).sum();
        let mut index = rng.random_range(0..total);
        for source in &self.sources {
            if index < source.images.len() {
                let image = &source.images[index];
                let from = rng.random_range(0..image.columns().saturating_sub(self.crop_columns).max(1));
                let mut crop = cut_columns(image, from, self.crop_columns);
                if rng.random_bool(0.5) {
                    mirror(&mut crop);
                }
                let reflectance = SimulatedReflectance::random(rng);
                return Sample::new(crop, source.drops_observed, reflectance, rng);
            }
            index -= source.images.len();
        }
        unreachable!("an index below the number of scans")
    }
}

impl SimulatedReflectance {
    pub(crate) fn random(rng: &mut impl Rng) -> Self {
        match rng.random_range(0..10) {
            0..5 => Self::Attenuation(rng.random_range(0.002..0.008)),
            5..7 => Self::Constant(rng.random_range(0.0..1.0)),
            _ => Self::Albedo(rng.random_range(2..12), rng.random_range(0.5..1.5)),
        }
    }

    /// The same of scans with labels: half the time each class has a reflectance of its own.
    pub(crate) fn random_where_labelled(rng: &mut impl Rng) -> Self {
        if rng.random_bool(0.5) { Self::ByClass(std::array::from_fn(|_| rng.random())) } else { Self::random(rng) }
    }

    /// The reflectances of an image, `[ring, column]`.
    pub(crate) fn of(self, image: &RangeImage) -> Vec<f32> {
        let (columns, range_m, measured) = (image.columns(), image.range_m(), image.reflectance());
        match self {
            Self::Attenuation(rate) => range_m.iter().map(|r| (-rate * r).exp()).collect(),
            Self::Constant(value) => vec![value; range_m.len()],
            Self::ByClass(values) => image.class().iter().map(|class| values[usize::from(*class)]).collect(),
            Self::Albedo(reach, gain) => (0..range_m.len())
                .map(|i| {
                    let row = i / columns * columns;
                    let window = i.saturating_sub(reach).max(row)..(i + reach + 1).min(row + columns);
                    let near = window.filter(|j| (range_m[*j] - range_m[i]).abs() < 0.1 * range_m[i]);
                    let (sum, n) = near.fold((0.0, 0), |(sum, n), j| (sum + measured[j], n + 1));
                    (gain * sum / n.max(1) as f32).clamp(0.0, 1.0)
                })
                .collect(),
        }
    }
}

impl Sample {
    /// A real image made to look simulated.
    pub fn new(real: RangeImage, drops_observed: bool, reflectance: SimulatedReflectance, rng: &mut impl Rng) -> Self {
        let filled = holes::fill(&real, rng);
        let reflectance = reflectance.of(&filled.image);
        let labelled = !rng.random_bool(UNLABELLED_SHARE);
        let jitter = Normal::new(0.0, JITTER_M).unwrap_or_else(|_| unreachable!("a positive standard deviation"));
        let mut simulated = filled.image;
        for (i, reflectance) in reflectance.iter().enumerate() {
            let range_m = simulated.range_m()[i];
            if range_m > 0.0 {
                let range_m = (range_m + jitter.sample(rng)).max(0.01);
                let class = if labelled { simulated.class()[i] } else { 0 };
                simulated.set(i, range_m, *reflectance, class);
            }
        }
        let keep_weight =
            if drops_observed { holes::weights(&filled.pixel, real.columns()) } else { vec![0.0; filled.pixel.len()] };
        Self { simulated, real, pixel: filled.pixel, keep_weight }
    }

    /// So many columns of it from `from` on, round the turn, left and right exchanged if it is `mirrored`.
    #[must_use]
    pub fn cut(&self, from: usize, count: usize, mirrored: bool) -> Self {
        let (rings, columns) = (self.real.rings(), self.real.columns());
        let column = move |k: usize| (from + if mirrored { count - 1 - k } else { k }) % columns;
        let pixels: Vec<usize> =
            (0..rings).flat_map(|ring| (0..count).map(move |k| ring * columns + column(k))).collect();
        let image = |image: &RangeImage| {
            let mut cut = cut_columns(image, from, count);
            if mirrored {
                mirror(&mut cut);
            }
            cut
        };
        Self {
            simulated: image(&self.simulated),
            real: image(&self.real),
            pixel: pixels.iter().map(|i| self.pixel[*i]).collect(),
            keep_weight: pixels.iter().map(|i| self.keep_weight[*i]).collect(),
        }
    }

    /// The same sample without the rays of these pixels, of which nothing is asked.
    #[must_use]
    pub fn without(mut self, pixels: &[usize]) -> Self {
        for i in pixels {
            self.simulated.remove(*i);
            (self.pixel[*i], self.keep_weight[*i]) = (Pixel::Empty, 0.0);
        }
        self
    }
}

impl Batch {
    /// Samples of one size as tensors.
    pub fn new(samples: &[Sample], device: &Device) -> Self {
        let (rings, columns) = (samples[0].real.rings(), samples[0].real.columns());
        let pixels = rings * columns;
        let mut scan = vec![0.0; samples.len() * 3 * pixels];
        for (sample, out) in samples.iter().zip(scan.chunks_mut(3 * pixels)) {
            sample.simulated.write_tensor(out);
        }
        let tensor = |channels: usize, values: Vec<f32>| {
            Tensor::from_data(TensorData::new(values, [samples.len(), channels, rings, columns]), device)
        };
        let channel = |value: &dyn Fn(&Sample, usize) -> f32| {
            tensor(1, samples.iter().flat_map(|s| (0..pixels).map(move |i| value(s, i))).collect())
        };
        let reported = |s: &Sample, i: usize| s.real.range_m()[i] > 0.0;
        Self {
            scan: tensor(3, scan),
            log_range: channel(&|s, i| s.real.range_m()[i].ln_1p()),
            reflectance: channel(&|s, i| s.real.reflectance()[i]),
            keep: channel(&|s, i| f32::from(u8::from(reported(s, i)))),
            keep_weight: channel(&|s, i| s.keep_weight[i]),
            measured: channel(&|s, i| f32::from(u8::from(reported(s, i) && s.simulated.range_m()[i] > 0.0))),
        }
    }
}

/// Swaps left and right.
fn mirror(image: &mut RangeImage) {
    let (columns, original) = (image.columns(), image.clone());
    for i in 0..original.range_m().len() {
        let from = i / columns * columns + (columns - 1 - i % columns);
        if original.range_m()[from] > 0.0 {
            image.set(i, original.range_m()[from], original.reflectance()[from], original.class()[from]);
        } else {
            image.remove(i);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pixel says which one it is.
    fn sample(columns: usize) -> Sample {
        let pixels = 2 * columns;
        let image = |from: f32| {
            let range_m = (0..pixels).map(|i| from + i as f32).collect();
            RangeImage::from_channels(columns, range_m, vec![0.5; pixels], vec![1; pixels])
        };
        let pixel = (0..pixels).map(|i| if i % 2 == 0 { Pixel::Kept } else { Pixel::Decoy }).collect();
        Sample {
            simulated: image(1.0),
            real: image(101.0),
            pixel,
            keep_weight: (0..pixels).map(|i| i as f32).collect(),
        }
    }

    #[test]
    fn simulators_that_know_materials_have_one_reflectance_a_class() {
        let image = RangeImage::from_channels(4, vec![3.0, 9.0, 3.0, 9.0], vec![0.1, 0.2, 0.3, 0.4], vec![1, 1, 9, 9]);
        let mut values = [0.0; CLASSES];
        (values[1], values[9]) = (0.7, 0.3);
        assert_eq!(SimulatedReflectance::ByClass(values).of(&image), [0.7, 0.7, 0.3, 0.3]);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let by_class = |x: &SimulatedReflectance| matches!(x, SimulatedReflectance::ByClass(_));
        let drawn = (0..1000).map(|_| SimulatedReflectance::random_where_labelled(&mut rng)).filter(by_class).count();
        assert!((400..600).contains(&drawn), "{drawn}");
    }

    #[test]
    fn a_cut_out_goes_round_the_turn_and_keeps_together_what_belongs_together() {
        for (mirrored, columns) in [(false, [6, 7, 0]), (true, [0, 7, 6])] {
            let cut = sample(8).cut(6, 3, mirrored);
            for (k, column) in columns.into_iter().enumerate() {
                for ring in 0..2 {
                    let (i, from) = (3 * ring + k, 8 * ring + column);
                    assert_eq!(cut.simulated.range_m()[i], 1.0 + from as f32, "{mirrored} {ring} {column}");
                    assert_eq!(cut.real.range_m()[i], 101.0 + from as f32);
                    assert_eq!(cut.keep_weight[i], from as f32);
                    assert_eq!(cut.pixel[i] == Pixel::Decoy, from % 2 == 1);
                }
            }
        }
    }
}
