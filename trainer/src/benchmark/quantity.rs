//! The numbers of a named effect beside those that were hidden: the one place that knows what each side calls them.
//!
//! | effect | hidden | found | compared as |
//! |---|---|---|---|
//! | encoder eccentricity | a, b of a·sin(nθ + b) | factors of sin nθ and cos nθ | a·cos b and a·sin b, a vector for each n |
//! | rolling shutter | velocity x, y; yaw rate | the same | velocity as a vector |
//! | range walk | −a·ln ρ | a·(1 − ρ^λ)/(λ·0.3^λ) | the curves at ρ = 0.05, 0.1, 0.2, 0.4, 0.8 |
//! | incidence stretch | b·tan α, noise s·tan α | both times (r/10 m)^k | b and s, and k within 0.1 of 0 |
//! | ring gain | g, o of each ring | the same | g − 1 and o |
//! | reflectance fall-off | r₀ = 0 for no overlap | r₀ > 0 | r₀ where there is one |
//! | specular | w for both | w for returns and d for reflectance | each with w |
//! | fog | α for both | α, and returns by κ·α | α, and κ with 1 |
//! | blocked sector | its edges | the same, in whatever turn | modulo 360°, against the width |
//! | random returns, precipitation, blooming | p, of which the base drop takes its share | p of what is reported | p·(1 − drop) |
//! | blooming | threshold | the same | not: no two reflectances lie close enough to tell thresholds apart |
//!
//! Everything else has one name on both sides.

use hidden::{Defect, Geometry, Noise, Range, Reflectance, Returns};

use super::row::{Named, Numbers};

/// Largest error of a quantity, as a share of the truth.
const TOLERANCE: f64 = 0.1;

/// Standard normal number below which 97.5 % lie.
const Z: f64 = 1.96;

/// A number of an effect, or a list that is judged as one: found and true, side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// What it is.
    pub name: &'static str,
    /// What was hidden, as a deviation from the value that does nothing.
    pub truth: Vec<f64>,
    /// What was found, likewise.
    pub found: Vec<f64>,
    /// Standard errors of what was found; empty where there are none for it.
    pub stderr: Vec<f64>,
    /// Largest root mean square error.
    pub tolerance: f64,
}

impl Quantity {
    fn new(name: &'static str, truth: Vec<f64>, found: &Numbers) -> Self {
        let tolerance = TOLERANCE * rms(truth.iter().copied());
        Self { name, truth, found: found.values.clone(), stderr: found.stderr.clone(), tolerance }
    }

    /// Root mean square error over its largest.
    pub fn error(&self) -> f64 {
        rms(self.found.iter().zip(&self.truth).map(|(found, truth)| found - truth)) / self.tolerance
    }

    /// Whether it is as close as asked.
    pub fn is_within(&self) -> bool {
        self.found.len() == self.truth.len() && self.error() <= 1.0
    }

    /// For each number whether its 95 % interval covers the truth.
    pub fn covered(&self) -> impl Iterator<Item = bool> {
        let numbers = self.found.iter().zip(&self.truth).zip(&self.stderr);
        numbers.map(|((found, truth), stderr)| (found - truth).abs() <= Z * stderr)
    }

    fn with_tolerance(self, tolerance: f64) -> Self {
        Self { tolerance, ..self }
    }

    /// Both as deviations from the value that does nothing.
    fn deviating_from(mut self, neutral: f64) -> Self {
        for x in self.truth.iter_mut().chain(&mut self.found) {
            *x -= neutral;
        }
        let tolerance = TOLERANCE * rms(self.truth.iter().copied());
        self.with_tolerance(tolerance)
    }

    /// Both without their means, if something else holds a part of them.
    fn without_mean(mut self, shared: bool) -> Self {
        if shared {
            for list in [&mut self.truth, &mut self.found] {
                let mean = list.iter().sum::<f64>() / list.len() as f64;
                for x in list.iter_mut() {
                    *x -= mean;
                }
            }
            self.stderr.clear();
        }
        self
    }
}

fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len() as f64;
    (values.map(|x| x * x).sum::<f64>() / n).sqrt()
}

/// The quantities of a defect that was named, in a set with this noise; `others` are the names of all effects that were added. Those that
/// the effect does not report are left out.
pub(super) fn quantities(defect: &Defect, noise: &Noise, named: &Named, others: &[&str]) -> Vec<Quantity> {
    let compare = Comparison { named, others, kept: 1.0 - noise.drop };
    let found = match defect {
        Defect::Geometry(defect) => compare.geometry(defect),
        Defect::Range(defect) => compare.range(defect),
        Defect::Reflectance(defect) => compare.reflectance(defect),
        Defect::Returns(defect) => compare.returns(defect),
        Defect::Unknown(_) => vec![],
    };
    found.into_iter().flatten().collect()
}

type Quantities = Vec<Option<Quantity>>;

struct Comparison<'a> {
    named: &'a Named,
    others: &'a [&'a str],
    /// Share of the returns that the base drop leaves.
    kept: f64,
}

impl Comparison<'_> {
    fn geometry(&self, defect: &Geometry) -> Quantities {
        match defect {
            Geometry::ElevationOffset { offset_deg } => vec![self.one("offset_deg", *offset_deg)],
            Geometry::ElevationOffsetPerRing { offset_deg } => {
                vec![self.per_ring("offset_deg", offset_deg, &["elevation_offset", "mount_height"])]
            }
            Geometry::AzimuthOffsetPerRing { offset_deg } => {
                vec![self.per_ring("offset_deg", offset_deg, &["mount_yaw"])]
            }
            Geometry::EncoderEccentricity { amplitude_deg, phase_deg, second_amplitude_deg, second_phase_deg } => {
                let wave = |name, factors, amplitude: &f64, phase_deg: &f64| {
                    let (sin, cos) = phase_deg.to_radians().sin_cos();
                    self.vector(name, factors, [amplitude * cos, amplitude * sin])
                };
                let first = wave("first_harmonic_deg", ["sin_deg", "cos_deg"], amplitude_deg, phase_deg);
                let factors = ["sin2_deg", "cos2_deg"];
                let second = wave("second_harmonic_deg", factors, second_amplitude_deg, second_phase_deg);
                vec![first, second.filter(|_| *second_amplitude_deg > 0.0)]
            }
            Geometry::MountRoll { roll_deg } => vec![self.one("roll_deg", *roll_deg)],
            Geometry::MountPitch { pitch_deg } => vec![self.one("pitch_deg", *pitch_deg)],
            Geometry::MountYaw { yaw_deg } => vec![self.one("yaw_deg", *yaw_deg)],
            Geometry::MountHeight { offset_m } => vec![self.one("offset_m", *offset_m)],
            Geometry::RollingShutter { velocity_x_m_s, velocity_y_m_s, yaw_rate_deg_s } => {
                let components = ["velocity_x_m_s", "velocity_y_m_s"];
                let velocity = self.vector("velocity_m_s", components, [*velocity_x_m_s, *velocity_y_m_s]);
                vec![velocity, self.one("yaw_rate_deg_s", *yaw_rate_deg_s)]
            }
        }
    }

    fn range(&self, defect: &Range) -> Quantities {
        match defect {
            Range::RangeOffset { offset_m } => vec![self.one("offset_m", *offset_m)],
            Range::RangeOffsetPerRing { offset_m } => {
                vec![self.per_ring("offset_m", offset_m, &["range_offset"])]
            }
            Range::RangeScale { scale } => vec![self.one("scale", *scale)],
            Range::RangeWalk { amplitude_m } => vec![self.walk(*amplitude_m)],
            Range::RangeNoise { sigma_per_m } => vec![self.one("sigma_per_m", *sigma_per_m)],
            Range::IncidenceStretch { bias_per_tan_m, sigma_per_tan_m } => vec![
                self.one("bias_per_tan_m", *bias_per_tan_m),
                self.one("spread_per_tan_m", *sigma_per_tan_m),
                self.one("range_power", 0.0).map(|q| q.with_tolerance(TOLERANCE)),
            ],
            Range::MixedPixels { probability } => vec![self.one("probability", *probability)],
            Range::Quantisation { step_m } => vec![self.one("step_m", *step_m)],
        }
    }

    fn reflectance(&self, defect: &Reflectance) -> Quantities {
        match defect {
            Reflectance::RingGain { gain, offset } => {
                let shared = &["reflectance_gain"];
                vec![
                    self.per_ring("gain", gain, shared).map(|q| q.deviating_from(1.0)),
                    self.per_ring("offset", offset, shared),
                ]
            }
            Reflectance::ReflectanceFalloff { beta_per_m, overlap_m } => {
                vec![
                    self.one("beta_per_m", *beta_per_m),
                    self.one("overlap_m", *overlap_m).filter(|_| *overlap_m > 0.0),
                ]
            }
            Reflectance::IncidenceFalloff { exponent } => vec![self.one("exponent", *exponent)],
            Reflectance::Saturation { maximum } => vec![self.one("maximum", *maximum)],
        }
    }

    fn returns(&self, defect: &Returns) -> Quantities {
        match defect {
            Returns::WeakReturnDrop { p_min_per_m2, softness, beta_per_m } => vec![
                self.one("p_min_per_m2", *p_min_per_m2),
                self.one("softness", *softness),
                self.one("beta_per_m", *beta_per_m),
            ],
            Returns::Specular { wetness } => vec![self.one("wetness", *wetness), self.one("darkening", *wetness)],
            Returns::Blooming { probability, length_deg, .. } => {
                vec![self.one("probability", *probability * self.kept), self.one("length_deg", *length_deg)]
            }
            Returns::RandomReturns { probability } => vec![self.one("probability", *probability * self.kept)],
            Returns::BlockedSector { from_deg, to_deg, drop, .. } => {
                let width_deg = (to_deg - from_deg).rem_euclid(360.0);
                let edge = |name, truth_deg: f64| {
                    let mut edge = self.one(name, truth_deg)?.with_tolerance(TOLERANCE * width_deg);
                    let away_deg = (edge.found[0] - truth_deg + 180.0).rem_euclid(360.0) - 180.0;
                    edge.found[0] = truth_deg + away_deg;
                    Some(edge)
                };
                vec![edge("from_deg", *from_deg), edge("to_deg", *to_deg), self.one("drop", *drop)]
            }
            Returns::RangeLimits { minimum_m, maximum_m } => {
                vec![self.one("minimum_m", *minimum_m), self.one("maximum_m", *maximum_m)]
            }
            Returns::Precipitation { probability_per_m, reach_m } => {
                vec![self.one("probability_per_m", *probability_per_m * self.kept), self.one("reach_m", *reach_m)]
            }
            Returns::Fog { alpha_per_m } => {
                vec![self.one("alpha_per_m", *alpha_per_m), self.one("drop_coupling", 1.0)]
            }
            Returns::Drift { range_m_per_frame, gain_per_frame } => {
                vec![self.one("range_m_per_frame", *range_m_per_frame), self.one("gain_per_frame", *gain_per_frame)]
            }
        }
    }

    fn numbers(&self, name: &str) -> Option<&Numbers> {
        self.named.parameters.iter().find(|numbers| numbers.name == name)
    }

    fn one(&self, name: &'static str, truth: f64) -> Option<Quantity> {
        let numbers = self.numbers(name).filter(|numbers| numbers.values.len() == 1)?;
        Some(Quantity::new(name, vec![truth], numbers))
    }

    fn per_ring(&self, name: &'static str, truth: &[f64], shared_with: &[&str]) -> Option<Quantity> {
        let numbers = self.numbers(name).filter(|numbers| numbers.values.len() == truth.len())?;
        let shared = self.others.iter().any(|other| shared_with.contains(other));
        Some(Quantity::new(name, truth.to_vec(), numbers).without_mean(shared))
    }

    fn vector(&self, name: &'static str, components: [&str; 2], truth: [f64; 2]) -> Option<Quantity> {
        let [first, second] = components.map(|component| self.numbers(component));
        let (first, second) = (first?, second?);
        let both = Numbers {
            name: name.into(),
            values: [&first.values[..], &second.values].concat(),
            stderr: [&first.stderr[..], &second.stderr].concat(),
        };
        Some(Quantity::new(name, truth.to_vec(), &both))
    }

    fn walk(&self, amplitude_m: f64) -> Option<Quantity> {
        const REFLECTANCES: [f64; 5] = [0.05, 0.1, 0.2, 0.4, 0.8];
        let [found_m, power] = ["amplitude_m", "exponent"].map(|name| self.numbers(name)?.values.first().copied());
        let (found_m, power) = (found_m?, power?);
        let found = |rho: &f64| {
            let family = if power.abs() < 1e-6 { -rho.ln() } else { (1.0 - rho.powf(power)) / power };
            found_m * family * 0.3_f64.powf(-power)
        };
        let curve = Numbers { name: "walk_m".into(), values: REFLECTANCES.iter().map(found).collect(), stderr: vec![] };
        let truth = REFLECTANCES.iter().map(|rho| -amplitude_m * rho.ln()).collect();
        Some(Quantity::new("walk_m", truth, &curve).without_mean(self.others.contains(&"range_offset")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(parameters: &[(&str, &[f64], &[f64])]) -> Named {
        let numbers = parameters.iter().map(|(name, values, stderr)| Numbers {
            name: (*name).into(),
            values: values.to_vec(),
            stderr: stderr.to_vec(),
        });
        Named { name: "any".into(), ties: vec![], gain_nats_per_pixel: 0.0, parameters: numbers.collect() }
    }

    #[test]
    fn a_tenth_off_is_within_and_more_is_not() {
        let defect = Defect::from(Range::RangeScale { scale: -0.003 });
        for (found, within, covered) in [(-0.003_29, true, false), (-0.003_31, false, false), (-0.003_01, true, true)] {
            let quantities = quantities(&defect, &Noise::default(), &named(&[("scale", &[found], &[1e-5])]), &[]);
            assert_eq!(quantities[0].is_within(), within, "{found}");
            assert_eq!(quantities[0].covered().collect::<Vec<_>>(), [covered], "{found}");
        }
    }

    #[test]
    fn rings_are_judged_together_and_without_a_mean_that_another_effect_has() {
        let defect = Defect::from(Range::RangeOffsetPerRing { offset_m: vec![0.03, -0.05, 0.02] });
        let shifted = named(&[("offset_m", &[0.04, -0.04, 0.03], &[1e-3; 3])]);
        assert!(!quantities(&defect, &Noise::default(), &shifted, &[])[0].is_within());
        let beside = &quantities(&defect, &Noise::default(), &shifted, &["range_offset_per_ring", "range_offset"])[0];
        assert!(beside.is_within() && beside.error() < 1e-9);
        assert_eq!(beside.covered().count(), 0);
    }

    #[test]
    fn an_encoders_phase_is_that_of_its_sine_and_cosine() {
        let geometry = Geometry::EncoderEccentricity {
            amplitude_deg: 0.2,
            phase_deg: 150.0,
            second_amplitude_deg: 0.0,
            second_phase_deg: 10.0,
        };
        // 0.2·sin(θ + 150°) = 0.2·cos 150°·sin θ + 0.2·sin 150°·cos θ.
        let found = named(&[
            ("sin_deg", &[-0.173_205_08], &[0.001]),
            ("cos_deg", &[0.1], &[0.001]),
            ("sin2_deg", &[0.0], &[0.001]),
            ("cos2_deg", &[0.0], &[0.001]),
        ]);
        let quantities = quantities(&Defect::from(geometry), &Noise::default(), &found, &[]);
        assert_eq!(quantities.len(), 1);
        assert!(quantities[0].error() < 1e-6, "{quantities:?}");
    }

    #[test]
    fn a_sector_through_straight_behind_has_its_edges_in_any_turn() {
        let sector = Returns::BlockedSector { from_deg: 170.0, to_deg: -170.0, drop: 0.9, rings: None };
        let found =
            named(&[("from_deg", &[-189.0], &[0.5]), ("to_deg", &[-168.0], &[0.5]), ("drop", &[0.88], &[0.02])]);
        let within: Vec<bool> =
            quantities(&Defect::from(sector), &Noise::default(), &found, &[]).iter().map(Quantity::is_within).collect();
        assert_eq!(within, [true, true, true]);
    }

    #[test]
    fn a_walk_of_another_form_is_judged_by_its_curve() {
        let defect = Defect::from(Range::RangeWalk { amplitude_m: 0.02 });
        let error = |power: f64| {
            let found = named(&[("amplitude_m", &[0.02], &[1e-3]), ("exponent", &[power], &[0.1])]);
            quantities(&defect, &Noise::default(), &found, &[])[0].error()
        };
        assert!(
            error(0.0) < 1e-9 && error(0.05) < 1.0 && error(1.0) > 1.0,
            "{} {} {}",
            error(0.0),
            error(0.05),
            error(1.0)
        );
    }
}
