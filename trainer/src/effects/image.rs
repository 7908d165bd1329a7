//! The image that effects act on: what the simulation says of each ray, and the distribution of what the sensor reports.

use burn::tensor::{Device, Tensor};

use super::extra::Extra;
use super::passage::Passage;
use super::rays::{Bend, Rays};
use super::surface::Surface;

/// Part of the way to the ray beside up to which a ray counts as not moved.
const HARDLY_MOVED: f64 = 0.001;

/// A batch of scans on their way through the sensor. Every tensor is `[batch, ring, column]` or broadcasts to it.
#[derive(Clone, Debug)]
pub struct Image {
    /// The sensor's rays, as its description has them.
    pub rays: Rays,
    /// By how much the true rays deviate from them; [`Image::resample`] spends it.
    pub bend: Bend,
    /// The surface that each ray hits.
    pub surface: Surface,
    /// The surface that a moved ray may have hit instead, where it passed between two rays of the simulation.
    pub other: Option<Other>,
    /// Half width at half maximum of what a moved ray's range may be off, in m, because its surface is not all known.
    pub doubt_m: Option<Tensor<3>>,
    /// The way of moved rays that begin elsewhere.
    pub passage: Option<Passage>,
    /// Number of the scan within its recording; 0 where nobody counts.
    pub frame: Tensor<3>,
    /// The distribution of what the sensor reports of the surface, given that the ray hits one.
    pub report: Report,
    /// What surfaces report that are seen at another angle than the image shows.
    pub other_angle: Option<OtherAngle>,
    /// Returns that come from no surface of the simulation, or replace it.
    pub extra: Vec<Extra>,
    /// Returns between two surfaces, of which a ray has one at most: their probabilities add up.
    pub mixed: Vec<Mixed>,
    /// The step in which ranges are reported.
    pub quantum: Option<Quantum>,
    /// The largest reflectance that is reported.
    pub ceiling: Option<Ceiling>,
}

/// Distribution of a report.
#[derive(Clone, Debug)]
pub struct Report {
    /// Mean range in m.
    pub range_m: Tensor<3>,
    /// Standard deviation of the range in m.
    pub range_sigma_m: Tensor<3>,
    /// Mean reflectance before it is held to 0–1.
    pub reflectance: Tensor<3>,
    /// Standard deviation of the reflectance.
    pub reflectance_sigma: Tensor<3>,
    /// Probability that a ray that hits the surface is reported.
    pub keep: Tensor<3>,
    /// Probability that a reported range has nothing to do with the surface.
    pub range_outliers: Tensor<3>,
    /// Probability that a reported reflectance has nothing to do with it.
    pub reflectance_outliers: Tensor<3>,
}

/// The second surface of a ray that passes between two.
#[derive(Clone, Debug)]
pub struct Other {
    /// What the moved ray sees of it.
    pub surface: Surface,
    /// Probability that the ray hits it rather than the first.
    pub weight: Tensor<3>,
}

/// What a surface reports if it is seen at another angle than the image shows.
#[derive(Clone, Debug)]
pub struct OtherAngle {
    /// Probability that it is.
    pub share: Tensor<3>,
    /// Mean reflectance, as a multiple of the report's.
    pub factor: Tensor<3>,
    /// Standard deviation of it, likewise.
    pub spread: Tensor<3>,
}

/// A return somewhere between two surfaces, uniformly.
#[derive(Clone, Debug)]
pub struct Mixed {
    /// Probability of one, given a return.
    pub probability: Tensor<3>,
    /// The nearer surface, in m; what else befalls the ray's range befalls it too.
    pub near_m: Tensor<3>,
    /// The farther one, in m.
    pub far_m: Tensor<3>,
}

/// Reflectances stop at a maximum: a report is min(I + noise, maximum), then scattered.
#[derive(Clone, Debug)]
pub struct Ceiling {
    /// The maximum.
    pub maximum: Tensor<3>,
    /// Standard deviation of the scatter: next to none where reports pile up at the very maximum.
    pub scatter: Tensor<3>,
}

/// Ranges come in multiples of a step.
#[derive(Clone, Debug)]
pub struct Quantum {
    /// The step in m.
    pub step_m: Tensor<3>,
    /// How sharply the multiples are kept: standard deviation in m.
    pub tooth_m: Tensor<3>,
}

/// Moved rays that leave no doubt what they see: 1, others 0.
#[derive(Clone, Debug)]
pub struct Settled {
    /// On which surface a ray ends: the simulation shows it all around.
    pub surface: Tensor<3>,
    /// Whether it ends on any: all rays around do, or none does.
    pub hit: Tensor<3>,
}

/// What a simulation says of a batch of scans.
#[derive(Clone, Debug)]
pub struct Simulated {
    /// Range in m, 0 where there is no return.
    pub range_m: Tensor<3>,
    /// Reflectance, 0–1.
    pub reflectance: Tensor<3>,
    /// Class index, 0 = unlabelled.
    pub class: Tensor<3>,
    /// Probability that a ray is reported, from a network; 1 for a simulation as it is.
    pub keep: Tensor<3>,
    /// Number of the scan within its recording, `[batch, 1, 1]`.
    pub frame: Tensor<3>,
}

impl Image {
    /// The image of a simulation whose sensor has no effects: exact and complete.
    pub fn new(simulated: Simulated, rays: Rays) -> Self {
        let surface = Surface::find(simulated.range_m, simulated.reflectance, simulated.class, &rays);
        let like = Tensor::<3>::zeros([1, 1, 1], &surface.range_m.device());
        let report = Report {
            range_m: surface.range_m.clone(),
            range_sigma_m: like.clone() + 1e-4,
            reflectance: surface.reflectance.clone(),
            reflectance_sigma: like.clone() + 1e-4,
            keep: simulated.keep,
            range_outliers: like.clone() + 1e-6,
            reflectance_outliers: like + 1e-6,
        };
        Self {
            rays,
            bend: Bend::default(),
            surface,
            other: None,
            doubt_m: None,
            passage: None,
            frame: simulated.frame,
            report,
            other_angle: None,
            extra: vec![],
            mixed: vec![],
            quantum: None,
            ceiling: None,
        }
    }

    /// Where the image lives.
    pub fn device(&self) -> Device {
        self.surface.range_m.device()
    }

    /// Probability that a ray hits a surface that the simulation knows.
    pub fn hit(&self) -> Tensor<3> {
        match &self.other {
            None => self.surface.hit.clone(),
            Some(other) => {
                let here = (other.weight.clone() * -1.0 + 1.0) * self.surface.hit.clone();
                here + other.weight.clone() * other.surface.hit.clone()
            }
        }
    }

    /// Which rays leave no doubt what they see, although the model moves rays; `None` if no ray was moved.
    ///
    /// Near an edge, or past something that it may meet, an image cannot know what a moved ray hits: what differs there says nothing of
    /// the rest.
    pub fn settled(&self) -> Option<Settled> {
        let other = self.other.as_ref()?;
        let still = other.weight.clone().lower_elem(HARDLY_MOVED).float();
        let settled = |of: &Tensor<3>| {
            let settled = of.clone().max_pair(still.clone() + of.zeros_like()).detach();
            match &self.passage {
                None => settled,
                Some(passage) => settled * passage.clear(&self.surface, &self.rays),
            }
        };
        Some(Settled { surface: settled(&self.surface.interior), hit: settled(&self.surface.alike) })
    }

    /// By how much the mean range differs from the surface's, in m.
    pub fn range_error_m(&self) -> Tensor<3> {
        self.report.range_m.clone() - self.surface.range_m.clone()
    }

    /// Probability that a ray that hits a surface hits the other one.
    pub fn beside(&self) -> Option<Tensor<3>> {
        self.other.as_ref().map(|other| other.weight.clone() * other.surface.hit.clone() / self.hit().clamp_min(1e-9))
    }

    /// Probability that none of the extra returns comes.
    pub fn no_extra(&self) -> Option<Tensor<3>> {
        self.extra.iter().map(|extra| extra.probability.clone() * -1.0 + 1.0).reduce(|a, b| a * b)
    }

    /// Probability that a ray is reported at all.
    pub fn reported(&self) -> Tensor<3> {
        let surface = self.hit() * self.report.keep.clone();
        match self.no_extra() {
            None => surface,
            Some(none) => (surface * -1.0 + 1.0) * none * -1.0 + 1.0,
        }
    }
}

impl OtherAngle {
    /// Mean and standard deviation of the reflectance at the other angle, where these are what the angle that the image shows makes of it.
    pub(crate) fn reflectance(&self, mean: &Tensor<3>, sigma: &Tensor<3>) -> [Tensor<3>; 2] {
        let spread = mean.clone() * self.spread.clone();
        [mean.clone() * self.factor.clone(), (sigma.clone().square() + spread.square()).sqrt()]
    }
}
