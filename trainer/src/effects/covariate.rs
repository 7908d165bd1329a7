//! What a residual may depend on: one number a ray, the same for screening and for tables.

use burn::tensor::Tensor;

use super::Image;
use super::blooming;
use super::neighbours::at;

/// Depth jumps count up to this, in m; a neighbour that hits nothing is one.
const LARGEST_JUMP_M: f64 = 10.0;

/// Reflectance from which a target is bright: that of retroreflectors.
const BRIGHT: f64 = 0.8;

/// A number that is known of each ray before anything is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Covariate {
    /// Number of the ring, 0 at the top.
    Ring,
    /// Azimuth in degrees to the left of ahead, −180 to 180.
    Azimuth,
    /// Range of the surface in m.
    Range,
    /// Angle between the ray and the surface's normal in degrees, 0 to 90.
    Incidence,
    /// Reflectance of the surface, 0 to 1.
    Reflectance,
    /// Class of the surface.
    Class,
    /// Height of the surface above the sensor in m.
    Height,
    /// Largest difference of the range to that of a neighbour along the ring, in m, at most 10.
    DepthJump,
    /// Angle to the nearest bright target in degrees.
    BrightDistance,
    /// Phase in the sweep, 0 to 1.
    SweepPhase,
    /// Number of the frame in its recording.
    Frame,
}

const NUMBER: usize = Covariate::ALL.len();

/// Names of every two covariates, for lists that live as long as the program.
static PAIRS: [[[&str; 2]; NUMBER]; NUMBER] = {
    let mut pairs = [[[""; 2]; NUMBER]; NUMBER];
    let mut i = 0;
    while i < NUMBER * NUMBER {
        pairs[i / NUMBER][i % NUMBER] = [Covariate::ALL[i / NUMBER].name(), Covariate::ALL[i % NUMBER].name()];
        i += 1;
    }
    pairs
};

impl Covariate {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Ring,
        Self::Azimuth,
        Self::Range,
        Self::Incidence,
        Self::Reflectance,
        Self::Class,
        Self::Height,
        Self::DepthJump,
        Self::BrightDistance,
        Self::SweepPhase,
        Self::Frame,
    ];

    /// Identifier, as in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ring => "ring",
            Self::Azimuth => "azimuth",
            Self::Range => "range",
            Self::Incidence => "incidence",
            Self::Reflectance => "reflectance",
            Self::Class => "class",
            Self::Height => "height",
            Self::DepthJump => "depth_jump",
            Self::BrightDistance => "bright_distance",
            Self::SweepPhase => "sweep_phase",
            Self::Frame => "frame",
        }
    }

    /// Identifier of a knot of a table over it.
    pub fn knot_name(self) -> String {
        format!("{}_knot", self.name())
    }

    /// Identifiers of one or two.
    pub fn names(some: &[Self]) -> &'static [&'static str] {
        match some {
            [] => &[],
            [a] => &PAIRS[*a as usize][*a as usize][..1],
            [a, b, ..] => &PAIRS[*a as usize][*b as usize],
        }
    }

    /// After how much it begins anew.
    pub fn period(self) -> Option<f32> {
        (self == Self::Azimuth).then_some(360.0)
    }

    /// Whether it begins anew.
    pub fn periodic(self) -> bool {
        self.period().is_some()
    }

    /// Its values, `[batch, ring, column]` or what broadcasts to it.
    pub fn of(self, image: &Image) -> Tensor<3> {
        let (rays, surface) = (&image.rays, &image.surface);
        match self {
            Self::Ring => rays.ring.clone(),
            Self::Azimuth => (rays.azimuth_rad.clone().rad2deg() + 180.0).remainder_scalar(360.0) - 180.0,
            Self::Range => surface.range_m.clone(),
            Self::Incidence => surface.cos_incidence.clone().acos().rad2deg(),
            Self::Reflectance => surface.reflectance.clone(),
            Self::Class => surface.class.clone(),
            Self::Height => surface.height_m(rays),
            Self::DepthJump => {
                let jump = |right: i64| {
                    let beside = at(&surface.range_m, 0, right, 0.0);
                    let none = beside.clone().lower_equal_elem(0.0);
                    (beside - surface.range_m.clone()).abs().mask_fill(none, LARGEST_JUMP_M)
                };
                jump(-1).max_pair(jump(1)).clamp_max(LARGEST_JUMP_M)
            }
            Self::BrightDistance => blooming::distance_deg(image, BRIGHT),
            Self::SweepPhase => rays.phase.clone(),
            Self::Frame => image.frame.clone(),
        }
    }

    /// At most `number` places at which a function of it is given, ascending: every class and every ring
    /// (which have channels of their own), whatever their number; evenly spaced where its values are; else such that as many values lie
    /// between any two.
    pub fn knots(self, mut values: Vec<f32>, number: usize) -> Vec<f32> {
        let number = number.max(2);
        if let Some(period) = self.period() {
            return (0..number).map(|k| period * (k as f32 / number as f32 - 0.5)).collect();
        }
        values.retain(|v| v.is_finite());
        values.sort_unstable_by(f32::total_cmp);
        let (Some(first), Some(last)) = (values.first().copied(), values.last().copied()) else { return vec![0.0] };
        let mut knots: Vec<f32> = match self {
            Self::Class | Self::Ring => values,
            Self::SweepPhase | Self::Frame => {
                (0..number).map(|k| first + (last - first) * k as f32 / (number - 1) as f32).collect()
            }
            _ => (0..number).map(|k| values[k * (values.len() - 1) / (number - 1)]).collect(),
        };
        // Knots that nearly coincide would make hats of no width.
        let least = (last - first) * 1e-3;
        knots.dedup_by(|next, knot| *next - *knot <= least);
        knots
    }
}
