//! From what the true rays met to what the sensor reports.

use lidar::RangeImage;
use rand::RngExt;

use crate::defect::Defect;
use crate::dice::{Dice, Purpose, dice, normal};
use crate::range::Range;
use crate::recipe::Recipe;
use crate::reflectance::Reflectance;
use crate::returns::Returns;
use crate::sweep::Sweep;

/// What a ray reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Return {
    pub(crate) range_m: f64,
    pub(crate) reflectance: f64,
}

/// A defect of the recipe with the random numbers that are its own in this frame.
struct Live<'a> {
    defect: &'a Defect,
    dice: Dice,
}

/// What a sensor reports of a sweep along its true rays: without classes, since no sensor sees them.
pub(crate) fn measure(sweep: &Sweep, recipe: &Recipe) -> RangeImage {
    let mut defects: Vec<Live> = (recipe.hidden.iter().enumerate())
        .map(|(n, defect)| Live { defect, dice: dice(recipe.seed, Purpose::Defect(n), sweep.frame) })
        .collect();
    let mut returns: Vec<Option<Return>> = (0..sweep.echoes().len()).map(|i| light(sweep, i, &mut defects)).collect();
    for live in &mut defects {
        for (pixel, ghost) in live.defect.ghosts(sweep, &mut live.dice) {
            returns[pixel] = Some(ghost);
        }
    }
    report(sweep, recipe, &mut defects, &returns)
}

/// What comes back along one ray and how long it takes; nothing where the echo is lost.
fn light(sweep: &Sweep, pixel: usize, defects: &mut [Live]) -> Option<Return> {
    let shot = sweep.shot(pixel)?;
    let (mut range_m, mut reflectance, mut lost) = (shot.echo.range_m, shot.echo.reflectance, false);
    for live in &mut *defects {
        range_m += live.defect.range_error_m(&shot, &mut live.dice);
        reflectance *= live.defect.light_factor(&shot);
        lost |= live.defect.loses(&shot, &mut live.dice);
    }
    for live in &*defects {
        reflectance = live.defect.amplified(shot.ray.ring, reflectance);
    }
    (!lost).then_some(Return { range_m, reflectance })
}

/// The sensor's own noise, drop, window, and numbers. Each ray draws its numbers whether it needs them or not, so that a defect
/// changes nothing but what it changes.
fn report(sweep: &Sweep, recipe: &Recipe, defects: &mut [Live], returns: &[Option<Return>]) -> RangeImage {
    let noise = &recipe.noise;
    let paper = Paper::new(sweep, &recipe.hidden);
    let mut dice = dice(recipe.seed, Purpose::Noise, sweep.frame);
    let mut image = RangeImage::empty(sweep.sensor.rings().len(), sweep.sensor.columns());
    for (pixel, back) in returns.iter().enumerate() {
        let range_error_m = noise.range_sigma_m * normal(&mut dice);
        let reflectance_error = noise.reflectance_sigma * normal(&mut dice);
        let mut dropped = dice.random::<f64>() < noise.drop;
        for live in &mut *defects {
            dropped |= live.defect.blocks(&sweep.ray(pixel), &mut live.dice);
        }
        let Some(back) = back.filter(|_| !dropped) else { continue };
        if let Some(range_m) = paper.range_m(back.range_m + range_error_m) {
            let reflectance = (back.reflectance + reflectance_error).clamp(0.0, paper.brightest);
            image.set(pixel, range_m as f32, reflectance as f32, 0);
        }
    }
    image
}

/// What numbers the sensor can report.
struct Paper {
    limits_m: [f64; 2],
    steps_m: Vec<f64>,
    brightest: f64,
}

impl Paper {
    fn new(sweep: &Sweep, defects: &[Defect]) -> Self {
        let (nearest_m, farthest_m) = sweep.sensor.range_limits_m();
        let mut paper = Self { limits_m: [nearest_m, farthest_m].map(f64::from), steps_m: Vec::new(), brightest: 1.0 };
        for defect in defects {
            match defect {
                Defect::Returns(Returns::RangeLimits { minimum_m, maximum_m }) => {
                    let [nearest_m, farthest_m] = paper.limits_m;
                    paper.limits_m = [nearest_m.max(*minimum_m), farthest_m.min(*maximum_m)];
                }
                Defect::Range(Range::Quantisation { step_m }) if *step_m > 0.0 => paper.steps_m.push(*step_m),
                Defect::Reflectance(Reflectance::Saturation { maximum }) => {
                    paper.brightest = paper.brightest.min(maximum.max(0.0));
                }
                _ => {}
            }
        }
        paper
    }

    /// A range as reported; none outside the limits.
    fn range_m(&self, range_m: f64) -> Option<f64> {
        let stepped_m = self.steps_m.iter().fold(range_m, |range_m, step_m| step_m * (range_m / step_m).round());
        let [nearest_m, farthest_m] = self.limits_m;
        (stepped_m > 0.0 && stepped_m >= nearest_m && stepped_m <= farthest_m).then_some(stepped_m)
    }
}
