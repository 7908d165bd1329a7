//! What methods learn between domains whose difference is known.

mod toy;

use std::sync::{Mutex, PoisonError};

use burn::tensor::{Device, Tensor, s};
use lidar::RangeImage;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use toy::{COLUMNS, FAR_M, Fact, config, measured, walls};
use trainer::network::resnet::IMAGE_CHANNELS;
use trainer::train::Parts;
use trainer::translation::losses::Judged;
use trainer::translation::method::{Approach, Setting, Step, approach};
use trainer::translation::sampler::scans;
use trainer::translation::twins::{Disguise, Twins};
use trainer::translation::{Domain, Sampler, TranslationConfig};

/// After so many steps, games are judged.
const STEPS: usize = 160;

/// The methods that play against a discriminator.
const GAMES: [&str; 3] = ["cls2r", "cyclegan", "gcgan"];

/// Standard deviations of what is reported about a middle.
const NEAR_SPREAD: f32 = 0.02;
const FAR_SPREAD: f32 = 0.1;

/// The mean over rays nearer and over those farther than [`FAR_M`].
fn by_distance(answer: &[f32], image: &RangeImage) -> (f32, f32) {
    let mean = |far: bool| {
        let rays: Vec<f32> =
            image.range_m().iter().zip(answer).filter(|(r, _)| (**r > FAR_M) == far).map(|(_, value)| *value).collect();
        rays.iter().sum::<f32>() / rays.len() as f32
    };
    (mean(false), mean(true))
}

/// A config's method with random weights of a start's own.
fn begun(
    config: &TranslationConfig,
    start: u64,
    device: &Device,
) -> Result<Box<dyn Approach>, Box<dyn std::error::Error>> {
    /// The device's random numbers are everybody's.
    static STARTS: Mutex<()> = Mutex::new(());
    let setting = Setting {
        generator: config.training_generator()?,
        reporting: config.reporting()?,
        losses: config.losses,
        image_numbers: IMAGE_CHANNELS * 16 * COLUMNS,
    };
    let _alone = STARTS.lock().unwrap_or_else(PoisonError::into_inner);
    device.seed(start);
    approach(config, setting, device)?.ok_or_else(|| "it plays against nobody".into())
}

/// Scans of both domains for a config's method.
fn sampler(config: &TranslationConfig) -> Sampler {
    let domain = |images: Vec<RangeImage>| Domain { images, datasets: vec![] };
    Sampler {
        simulated: domain((0..20).map(walls).collect()),
        real: domain((100..120).map(measured).collect()),
        seed: 1,
        batch: config.schedule.batch,
        crop_columns: COLUMNS,
        augmentation: config.augmentation,
        disguise: config.has_twins().then(Disguise::default),
    }
}

/// What a step is shown.
fn step(config: &TranslationConfig, sampler: &Sampler, number: usize, device: &Device) -> Result<Step, anyhow::Error> {
    let coding = config.reporting()?.coding;
    let pair = sampler.pair(number, device);
    let [simulated, real] = [pair.simulated, pair.real].map(|scan| coding.view(&scan));
    let twins = sampler.twins(number, coding, device);
    Ok(Step { simulated, real, twins, seed: 1, number, rate: config.schedule.rate(number) })
}

/// The probabilities after so many steps, from random weights of a start's own, twins weighing so much.
fn learned(method: &str, twins: f64, start: u64, steps: usize) -> Result<(f32, f32), Box<dyn std::error::Error>> {
    let mut config = config(method, "")?;
    config.losses.twins = twins;
    let device = Device::flex().autodiff();
    let mut learner = begun(&config, start, &device)?;
    let sampler = sampler(&config);
    for number in 0..steps {
        learner.step(&step(&config, &sampler, number, &device)?);
    }
    let image = walls(1000);
    let view = config.reporting()?.coding.view(&scans(std::slice::from_ref(&image), &device));
    let logit: Tensor<4> = learner.generator().forward(view.image, &view.condition).keep_logit;
    let keep: Vec<f32> = burn::tensor::activation::sigmoid(logit).slice(s![0..1]).into_data().iter::<f32>().collect();
    Ok(by_distance(&keep, &image))
}

/// The sensor keeps all near rays and four of ten far ones; to begin with, about half of all. So few steps of a game between two networks
/// may end elsewhere: about one start of four does, so a method has five.
fn learns_which_rays_are_lost(method: &str) -> Fact {
    let mut kept = vec![];
    for start in 1..=5 {
        let (near, far) = learned(method, 0.0, start, STEPS)?;
        if near > 0.8 && far < 0.7 {
            return Ok(());
        }
        kept.push((near, far));
    }
    Err(format!("near and far rays are kept with {kept:?}").into())
}

#[test]
fn cls2r_learns_which_rays_are_lost() -> Fact {
    learns_which_rays_are_lost("cls2r")
}

/// What no game between two networks promises: the probability itself, from any start; with any game beside it, and without one.
fn twins_tell(method: &str, weight: f64, steps: usize, starts: u64) -> Fact {
    for start in 1..=starts {
        let (near, far) = learned(method, weight, start, steps)?;
        assert!(
            near > 0.9 && (0.25..0.6).contains(&far),
            "{method}, start {start}: near and far rays are kept with {near}, {far}"
        );
    }
    Ok(())
}

#[test]
fn twins_tell_cls2r_how_many_rays_are_lost() -> Fact {
    twins_tell("cls2r", 1.0, STEPS, 2)
}

/// Its cycles would have every ray reported, and are outweighed.
#[test]
fn twins_tell_cycle_gan_how_many_rays_are_lost() -> Fact {
    twins_tell("cyclegan", 20.0, STEPS, 1)
}

#[test]
fn twins_tell_gc_gan_how_many_rays_are_lost() -> Fact {
    twins_tell("gcgan", 20.0, STEPS, 1)
}

#[test]
fn twins_alone_say_how_many_rays_are_lost() -> Fact {
    twins_tell("paired", 0.0, 3 * STEPS, 2)
}

/// The real sensor's reflectances scatter about 0.8: those of near rays little, those of far ones much. The simulator's are 1.
#[test]
fn twins_say_how_far_reflectances_scatter() -> Fact {
    let mut config = config("paired", "")?;
    config.generator.scatter = true;
    let device = Device::flex().autodiff();
    let mut sampler = sampler(&config);
    sampler.disguise = Some(Disguise { attenuation_per_m: Some(0.0), ..Disguise::default() });
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let normal = Normal::new(0.0, 1.0)?;
    for image in &mut sampler.real.images {
        for i in 0..image.range_m().len() {
            let range_m = image.range_m()[i];
            if range_m > 0.0 {
                let spread = if range_m > FAR_M { FAR_SPREAD } else { NEAR_SPREAD };
                image.set(i, range_m, 0.8 + spread * normal.sample(&mut rng), image.class()[i]);
            }
        }
    }
    let mut learner = begun(&config, 1, &device)?;
    for number in 0..3 * STEPS {
        learner.step(&step(&config, &sampler, number, &device)?);
    }
    let mut image = walls(1000);
    (0..16 * COLUMNS).for_each(|i| image.set(i, image.range_m()[i], 1.0, image.class()[i]));
    let view = config.reporting()?.coding.view(&scans(std::slice::from_ref(&image), &device));
    let scatter = learner.generator().forward(view.image, &view.condition).scatter.ok_or("no scatter")?;
    // The code is twice as wide as reflectances are.
    let scatter: Vec<f32> = scatter.into_data().iter::<f32>().map(|scale| scale / 2.0).collect();
    let (near, far) = by_distance(&scatter, &image);
    let between = |found: f32, spread: f32| (0.5 * spread..1.5 * spread).contains(&found);
    assert!(between(near, NEAR_SPREAD) && between(far, FAR_SPREAD), "{near} {far}");
    Ok(())
}

/// Of both kinds of answers alike, each beside what was measured in such places.
#[test]
fn a_discriminator_judges_answers_to_twins_as_well_where_that_is_asked_for() -> Fact {
    GAMES.into_iter().try_for_each(judges_answers_to_twins)
}

fn judges_answers_to_twins(method: &str) -> Fact {
    let mut config = config(method, "")?;
    config.losses.twins = 1.0;
    // So that what is judged are this step's answers.
    config.losses.pool = 0;
    // So that nothing about an answer is drawn.
    config.ray_drop = false;
    let device = Device::flex().autodiff();
    let both = step(&config, &sampler(&config), 0, &device)?;
    let Some(Twins { shown, measured, .. }) = both.twins.clone() else { return Err("no twins".into()) };
    let twins_alone = Step { simulated: shown, real: measured, ..both.clone() };
    // To begin with it knows nothing, and says the same of everything.
    let mut knowing = begun(&config, 1, &device)?;
    for _ in 0..8 {
        knowing.step(&both);
    }
    let mut known = Parts::default();
    knowing.save(&mut known)?;
    let mut loss = |judged: Judged, step: &Step| -> Result<f32, Box<dyn std::error::Error>> {
        config.losses.judged = judged;
        let mut method = begun(&config, 1, &device)?;
        method.load(&known)?;
        let losses = method.step(step);
        Ok(losses.iter().find(|(name, _)| *name == "discriminator").ok_or("no discriminator")?.1)
    };
    let simulated = loss(Judged::Simulated, &both)?;
    let (twins, both) = (loss(Judged::Simulated, &twins_alone)?, loss(Judged::WithTwins, &both)?);
    assert!((simulated - twins).abs() > 1e-3, "{method}: {simulated} {twins}");
    assert!((both - f32::midpoint(simulated, twins)).abs() < 1e-4, "{method}: {both} of {simulated} and {twins}");
    Ok(())
}

#[test]
fn cycle_gan_learns_which_rays_are_lost() -> Fact {
    learns_which_rays_are_lost("cyclegan")
}

#[test]
fn gc_gan_learns_which_rays_are_lost() -> Fact {
    learns_which_rays_are_lost("gcgan")
}
