//! The closed loop without twins: real scans against simulated scans of other places.
//!
//! Rays cannot be compared, distributions can. Both halves are reduced to *cells*, returns of one ring that see one class of surface in one
//! direction at one range and angle. An effect is a regression on its covariate within strata of cells, the same in both halves, and what
//! differs is the sensor's: rings are compared where they see one surface at one range and angle; ranges and angles where one class of
//! surface is seen in one direction, and by each ring alone once the rings are found to differ. How bright a place is never counts, for
//! every stratum has a constant of its own. The steps are those of the paired loop: noise floor, attribution on held-out scenes against a
//! placebo, false discoveries controlled, forward addition, confirmation on scenes opened once. The claims are fewer: see
//! [`CANNOT_BE_SEEN`].

mod cells;
mod compare;
mod covariate;
mod delivery;
mod detection;
mod evidence;
mod falloff;
mod finding;
mod noise;
mod parts;
mod report;
#[cfg(test)]
mod tests;
mod traces;
mod unseen;

use std::collections::BTreeSet;

use lidar::{RangeImage, Sensor};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

pub use covariate::Over;
pub use delivery::UnpairedDelivery;
pub use finding::{Curve, Finding, Point, Tried};
pub use noise::Noise;
pub use report::UnpairedReport;
pub use unseen::{CANNOT_BE_SEEN, Unseen};

use self::cells::{Cells, Makes, Powers};
use self::covariate::View;
use self::detection::together;
use self::evidence::Evidence;
use self::parts::Parts;
use self::traces::{FALSE_CLAIMS, Traces};
use super::significance::benjamini_hochberg;
use crate::sets::{LoneScan, UnpairedSet};

/// One half: cells by scene.
struct Half {
    scenes: Vec<Cells>,
    /// Scans of each scene, by number.
    frames: Vec<Vec<usize>>,
    images: Vec<RangeImage>,
}

/// Closes the loop on scans without twins.
pub fn compare(set: &UnpairedSet, seed: u64) -> Finding {
    let sensor = &set.sensor;
    let images = |scans: &[LoneScan]| scans.iter().map(|scan| scan.image.clone()).collect::<Vec<_>>();
    let measured_images = images(&set.measured);
    let noise = Noise::of(measured_images.iter(), sensor);
    let ideal = Noise::of(set.simulated.iter().map(|scan| &scan.image), sensor);
    let simulated_images = noisy(&set.simulated, noise.beyond(ideal), seed);
    let labelled = set.has_labels && set.measured.iter().all(|s| s.image.class().iter().any(|class| *class > 0));

    let mut simulated = Half::new(&set.simulated, simulated_images, sensor, labelled);
    let mut measured = Half::new(&set.measured, measured_images, sensor, labelled);
    let parts = Parts::new([&simulated, &measured].map(|half| half.scenes.len()), seed);
    let elevations_rad: Vec<f64> = sensor.rings().iter().map(|ring| ring.elevation_rad).collect();
    let plain = View {
        elevations_rad: &elevations_rad,
        makes: Makes::default(),
        rings_differ: false,
        log_weak: log_weak([&simulated, &measured]),
    };

    // Where weak returns are lost, reflectances are those of the survivors: look for that first, to leave such places out.
    // Whether it is claimed is decided at the end, when the reflectances are known.
    let power = Traces::new(Over::Power, [&simulated, &measured], [&plain, &plain], &parts, seed);
    if let Some(log_power) = power.log_tenth().filter(|_| power.passes(power.p())) {
        simulated.keep_strong(log_power);
        measured.keep_strong(log_power);
    }
    let mut steps = Steps { views: [plain.clone(), plain], parts: &parts, seed, tried: Vec::new() };
    let ring = steps.traces(Over::Ring, &simulated, &measured);
    let rings_differ = steps.decide(&ring, &[]);
    for view in &mut steps.views {
        // Gains are known but for a trend, which on the ground is one over range.
        view.rings_differ = rings_differ;
        view.makes = Makes::default();
    }
    steps.fade(&simulated, &measured);

    // Power is that of the reflectance as it was before the sensor's doing.
    let mut makes = steps.views[1].makes.clone();
    if rings_differ {
        ring.enter(&mut makes);
    }
    measured.look_for_chances(sensor, &makes);
    for view in &mut steps.views {
        view.log_weak = log_weak([&simulated, &measured]);
    }
    let power = steps.traces(Over::Power, &simulated, &measured);
    steps.decide(&power, &[]);
    Finding::new(noise, steps.tried, parts.caveats.iter().chain(&set.notes).cloned().collect(), &parts)
}

/// ln of the power that a quarter of all returns are expected to be weaker than.
fn log_weak(halves: [&Half; 2]) -> f64 {
    let powers = together(halves.map(Half::powers).iter().flatten());
    let all: f64 = powers.iter().map(|chances| chances.rays).sum();
    let mut weaker = 0.0;
    let weak = powers.iter().position(|chances| {
        weaker += chances.rays;
        weaker > 0.25 * all
    });
    cells::log_power(weak.unwrap_or_default())
}

/// What has been tried so far, and how scans are looked at since.
struct Steps<'a> {
    /// Simulated, measured.
    views: [View<'a>; 2],
    parts: &'a Parts,
    seed: u64,
    tried: Vec<Tried>,
}

impl Steps<'_> {
    fn traces(&self, over: Over, simulated: &Half, measured: &Half) -> Traces {
        let [a, b] = &self.views;
        Traces::new(over, [simulated, measured], [a, b], self.parts, self.seed)
    }

    /// Tries what fades with range and with the angle, which on the ground and along every wall change together: the better one first, the
    /// other beside it; and the first goes if beside the other it no longer earns its place.
    fn fade(&mut self, simulated: &Half, measured: &Half) {
        let [range, incidence] = [Over::Range, Over::Incidence].map(|over| self.traces(over, simulated, measured));
        let (better, other) = if range.nats() > incidence.nats() { (range, incidence) } else { (incidence, range) };
        let tie = |name: &str| if better.ties_with(&other) { vec![name.to_owned()] } else { vec![] };
        let first = self.decide(&better, &tie(other.name()));
        let beside = self.traces(other.over(), simulated, measured);
        self.decide(&beside, &[]);
        if !first || beside.p() > FALSE_CLAIMS {
            return;
        }
        let before = self.views[1].makes.clone();
        self.views[1].makes = Makes::default();
        other.enter(&mut self.views[1].makes);
        let again = self.traces(better.over(), simulated, measured);
        if again.passes(again.p()) {
            self.views[1].makes = before;
        } else {
            self.tried.truncate(self.tried.len() - 2);
            self.decide(&other, &tie(better.name()));
            self.decide(&again, &[]);
        }
    }

    /// Claims an effect or does not, those that are still to come counting as tried without success; what is claimed is undone from here on.
    fn decide(&mut self, traces: &Traces, ties: &[String]) -> bool {
        let to_come = Over::COUNT - 1 - self.tried.len();
        let p: Vec<f64> =
            self.tried.iter().map(|tried| tried.p).chain([traces.p()]).chain(vec![1.0; to_come]).collect();
        let q = benjamini_hochberg(&p)[self.tried.len()];
        let tried = traces.tried(q, ties);
        let claimed = tried.found.is_some();
        if claimed {
            traces.enter(&mut self.views[1].makes);
        }
        self.tried.push(tried);
        claimed
    }
}

/// Simulated scans with noise on top.
fn noisy(scans: &[LoneScan], noise: Noise, seed: u64) -> Vec<RangeImage> {
    let give = |(i, scan): (usize, &LoneScan)| {
        noise.give(&scan.image, &mut ChaCha8Rng::seed_from_u64(seed ^ ((i as u64 + 1) << 24)))
    };
    scans.par_iter().enumerate().map(give).collect()
}

impl Half {
    fn new(scans: &[LoneScan], images: Vec<RangeImage>, sensor: &Sensor, labelled: bool) -> Self {
        let known: BTreeSet<usize> = scans.iter().map(|scan| scan.scene).collect();
        let of_scene = |scene: &usize| (0..scans.len()).filter(|i| scans[*i].scene == *scene).collect::<Vec<_>>();
        let frames: Vec<Vec<usize>> = known.iter().map(of_scene).collect();
        let cells = |frames: &Vec<usize>| {
            let mut cells = Cells::default();
            for frame in frames {
                cells.add_returns(*frame, &images[*frame], sensor, labelled);
            }
            cells
        };
        let scenes = frames.par_iter().map(cells).collect();
        let mut half = Self { scenes, frames, images };
        half.look_for_chances(sensor, &Makes::default());
        half
    }

    /// Looks for rays that should have returned, with the power that is expected of surfaces whose reflectance was not yet made what it is.
    fn look_for_chances(&mut self, sensor: &Sensor, makes: &Makes) {
        let images = &self.images;
        self.scenes.par_iter_mut().zip(&self.frames).for_each(|(cells, frames)| {
            cells.chances.clear();
            for frame in frames {
                cells.add_chances(*frame, &images[*frame], sensor, makes);
            }
        });
    }

    fn keep_strong(&mut self, log_power: f64) {
        for cells in &mut self.scenes {
            cells.keep_strong(log_power);
        }
    }

    fn powers(&self) -> Vec<Powers> {
        self.scenes.iter().map(Cells::powers).collect()
    }

    fn evidence(&self, of: impl Fn(&Cells, usize) -> Evidence + Sync) -> Vec<Evidence> {
        self.scenes.par_iter().zip(&self.frames).map(|(cells, frames)| of(cells, frames.len())).collect()
    }
}
