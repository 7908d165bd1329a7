//! A smooth function of one or two covariates, for what has no name.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

use burn::tensor::{Device, Tensor, TensorData, s};

use super::covariate::Covariate;
use super::{About, ActsOn, Channel, Effect, Extent, Image, Parameter, Values};

/// A number at every knot (of one covariate, or of a grid of two), and straight lines between them: linear hat functions. Beyond its first
/// and last knots it stays what it is there; around a circle it goes on.
#[derive(Clone, Debug, PartialEq)]
pub struct SmoothTable {
    name: &'static str,
    target: Target,
    axes: Vec<Axis>,
}

/// What a table changes; 0 throughout leaves it as it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Target {
    /// The mean range: metres are added.
    Range,
    /// The range's spread: its logarithm is added to.
    RangeSpread,
    /// The mean reflectance: added to.
    Reflectance,
    /// The mean reflectance: made larger by this share of it.
    ReflectanceGain,
    /// The probability that a ray is reported: its logit is added to.
    Missing,
}

/// A covariate and its knots.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// The covariate.
    pub covariate: Covariate,
    /// Where the function is given, ascending.
    pub knots: Vec<f32>,
}

impl Target {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Range, Self::RangeSpread, Self::Reflectance, Self::ReflectanceGain, Self::Missing];

    /// Identifier.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Range => "range",
            Self::RangeSpread => "range_spread",
            Self::Reflectance => "reflectance",
            Self::ReflectanceGain => "reflectance_gain",
            Self::Missing => "missing",
        }
    }

    /// The channel that it belongs to.
    pub const fn channel(self) -> Channel {
        match self {
            Self::Range => Channel::Range,
            Self::RangeSpread => Channel::RangeVariance,
            Self::Reflectance | Self::ReflectanceGain => Channel::Reflectance,
            Self::Missing => Channel::Missing,
        }
    }

    const fn acts_on(self) -> ActsOn {
        match self {
            Self::Range | Self::RangeSpread => ActsOn::RANGE,
            Self::Reflectance | Self::ReflectanceGain => ActsOn::REFLECTANCE,
            Self::Missing => ActsOn::RETURNS,
        }
    }

    /// Name, unit and typical size of the numbers, and what they do.
    const fn parameter(self) -> (Parameter, &'static str, &'static str) {
        match self {
            Self::Range => (Parameter::free("range_m", 0.02, (-20.0, 20.0)), "ranges", "r + f"),
            Self::RangeSpread => (Parameter::free("log_factor", 0.2, (-10.0, 10.0)), "range noise", "σ_r·eᶠ"),
            Self::Reflectance => (Parameter::free("reflectance", 0.02, (-2.0, 2.0)), "reflectances", "I + f"),
            Self::ReflectanceGain => (Parameter::free("gain", 0.1, (-2.0, 20.0)), "reflectances", "I·(1 + f)"),
            Self::Missing => (Parameter::free("log_odds", 0.3, (-15.0, 15.0)), "missing returns", "logit(keep) + f"),
        }
    }
}

impl SmoothTable {
    /// A table over one or two covariates, with at most so many knots along each, placed where the values on rays that hit something are.
    ///
    /// # Panics
    /// If there are no covariates, or more than two.
    pub fn new<'a>(
        target: Target,
        covariates: &[Covariate],
        images: impl IntoIterator<Item = &'a Image>,
        knots: usize,
    ) -> Self {
        let mut values = vec![Vec::new(); covariates.len()];
        for image in images {
            let hit = numbers(&image.surface.hit);
            for (covariate, values) in covariates.iter().zip(&mut values) {
                let all = numbers(&covariate.of(image).expand(image.surface.hit.shape()));
                values.extend(all.into_iter().zip(&hit).filter(|(_, hit)| **hit > 0.5).map(|(value, _)| value));
            }
        }
        let axis = |(covariate, values): (&Covariate, Vec<f32>)| Axis {
            covariate: *covariate,
            knots: covariate.knots(values, knots),
        };
        Self::on(target, covariates.iter().zip(values).map(axis).collect())
    }

    /// A table over these knots.
    ///
    /// # Panics
    /// If there are no axes, or more than two, or one without knots.
    pub fn on(target: Target, axes: Vec<Axis>) -> Self {
        assert!((1..=2).contains(&axes.len()), "a table has one axis or two, not {}", axes.len());
        assert!(axes.iter().all(|axis| !axis.knots.is_empty()), "an axis without knots");
        let covariates: Vec<&str> = axes.iter().map(|axis| axis.covariate.name()).collect();
        let name = for_ever(format!("smooth_table_{}_by_{}", target.name(), covariates.join("_and_")));
        Self { name, target, axes }
    }

    /// What it changes.
    pub fn target(&self) -> Target {
        self.target
    }

    /// Its axes; the numbers of the first run slower.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// The function's values on an image, for these numbers at the knots.
    fn values(&self, at_knots: Tensor<1>, image: &Image) -> Tensor<3> {
        let count = |axis: &Axis| axis.knots.len() as i64;
        match self.axes.as_slice() {
            [axis] => {
                let x = axis.covariate.of(image);
                let table = axis.closed(at_knots.reshape([count(axis), 1]));
                axis.hats(&x).matmul(table).reshape(x.dims())
            }
            [first, second, ..] => {
                let size = image.surface.range_m.shape();
                let hats = |axis: &Axis| axis.hats(&axis.covariate.of(image).expand(size.clone()));
                let table = first.closed(at_knots.reshape([count(first), count(second)]));
                let table = second.closed(table.transpose()).transpose();
                (hats(first).matmul(table) * hats(second)).sum_dim(1).reshape(size.clone())
            }
            [] => unreachable!("a table has axes"),
        }
    }
}

impl Axis {
    /// Knots with the first once more at the end, if the axis is a circle.
    fn around(&self) -> Vec<f32> {
        let again = self.covariate.period().map(|period| self.knots[0] + period);
        self.knots.iter().copied().chain(again).collect()
    }

    /// Numbers at the knots, `[knot, …]`, with the first row once more at the end, if the axis is a circle.
    fn closed(&self, rows: Tensor<2>) -> Tensor<2> {
        if self.covariate.periodic() { Tensor::cat(vec![rows.clone(), rows.slice(s![0..1, ..])], 0) } else { rows }
    }

    /// Each knot's share in the value at each pixel, `[pixel, knot]`; a pixel's shares add up to 1.
    fn hats(&self, x: &Tensor<3>) -> Tensor<2> {
        let knots = self.around();
        let n = knots.len();
        // A hat is the lesser of a line that rises from the knot before and one that falls to the knot after, held to 0–1; the first
        // hat's left and the last one's right line is 1.
        let line = |at_zero_and_slope: &dyn Fn(usize) -> Option<(f32, f32)>| {
            let lines: Vec<(f32, f32)> = (0..n).map(|j| at_zero_and_slope(j).unwrap_or((1.0, 0.0))).collect();
            let row = |of: &dyn Fn(&(f32, f32)) -> f32, device: &Device| {
                Tensor::<2>::from_data(TensorData::new(lines.iter().map(of).collect::<Vec<f32>>(), [1, n]), device)
            };
            let device = x.device();
            column(x) * row(&|line| line.1, &device) + row(&|line| line.0, &device)
        };
        let rising = line(&|j| {
            let before = *knots.get(j.checked_sub(1)?)?;
            Some((-before / (knots[j] - before), 1.0 / (knots[j] - before)))
        });
        let falling = line(&|j| {
            let after = *knots.get(j + 1)?;
            Some((after / (after - knots[j]), -1.0 / (after - knots[j])))
        });
        rising.min_pair(falling).clamp(0.0, 1.0)
    }
}

impl Effect for SmoothTable {
    fn about(&self) -> About {
        let (_, _, formula) = self.target.parameter();
        About {
            name: self.name,
            does: match self.target {
                Target::Range => "has range errors without a name",
                Target::RangeSpread => "has range noise that no effect explains",
                Target::Reflectance | Target::ReflectanceGain => "has reflectance errors without a name",
                Target::Missing => "loses returns for no known reason",
            },
            channel: self.target.channel(),
            acts_on: self.target.acts_on(),
            covariates: Covariate::names(&self.axes.iter().map(|axis| axis.covariate).collect::<Vec<_>>()),
            formula,
            source: "first-order splines: de Boor, A Practical Guide to Splines (1978)",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        let (mut parameter, _, _) = self.target.parameter();
        parameter.extent = Extent::Knots(self.axes.iter().map(|axis| axis.knots.len()).product());
        vec![parameter]
    }

    fn constants(&self) -> Vec<(String, f64)> {
        let of = |axis: &Axis| {
            let name = axis.covariate.knot_name();
            axis.knots.iter().map(|knot| (name.clone(), f64::from(*knot))).collect::<Vec<_>>()
        };
        self.axes.iter().flat_map(of).collect()
    }

    fn forward(&self, values: &Values, mut image: Image) -> Image {
        let f = self.values(values.all(0), &image);
        let report = &mut image.report;
        match self.target {
            Target::Range => report.range_m = report.range_m.clone() + f,
            Target::RangeSpread => report.range_sigma_m = report.range_sigma_m.clone() * f.exp(),
            Target::Reflectance => report.reflectance = report.reflectance.clone() + f,
            Target::ReflectanceGain => report.reflectance = report.reflectance.clone() * (f + 1.0),
            Target::Missing => {
                // The logistic function of logit(k) + f, without the infinities of the logit.
                let odds = report.keep.clone() * f.exp();
                report.keep = odds.clone() / (report.keep.clone() * -1.0 + 1.0 + odds).clamp_min(1e-9);
            }
        }
        image
    }
}

fn column(x: &Tensor<3>) -> Tensor<2> {
    let [batch, rings, columns] = x.dims();
    x.clone().reshape([batch * rings * columns, 1])
}

fn numbers(x: &Tensor<3>) -> Vec<f32> {
    x.clone().into_data().iter::<f32>().collect()
}

/// The same text for as long as the program runs: each name is kept once, and there are only so many covariates.
fn for_ever(name: String) -> &'static str {
    static NAMES: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
    let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = names.get(name.as_str()) {
        return known;
    }
    let name: &'static str = name.leak();
    names.insert(name);
    name
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::closed_loop::data::Batch;
    use crate::closed_loop::fit::{Free, Manner, On, fit};
    use crate::closed_loop::model::{SensorModel, Term};
    use crate::closed_loop::score::Scope;
    use crate::effects::trial::{measured_by, sensor};

    /// An error of the range, the reflectance or the returns that the library has no name for.
    #[derive(Clone, Copy, Debug)]
    struct MadeUp(Target, fn(&Image) -> Tensor<3>);

    impl Effect for MadeUp {
        fn about(&self) -> About {
            let (channel, acts_on) = (self.0.channel(), self.0.acts_on());
            About { name: "made_up", does: "", channel, acts_on, covariates: &[], formula: "", source: "" }
        }

        fn parameters(&self) -> Vec<Parameter> {
            vec![]
        }

        fn forward(&self, _: &Values, mut image: Image) -> Image {
            let error = (self.1)(&image);
            match self.0 {
                Target::Missing => image.report.keep = image.report.keep * error,
                Target::Reflectance => image.report.reflectance = image.report.reflectance + error,
                _ => image.report.range_m = image.report.range_m + error,
            }
            image
        }
    }

    /// Fits a table to scans with a made-up error; root mean square difference of what the model and the truth report, on rays that hit.
    fn error_left(made_up: MadeUp, covariates: &[Covariate], knots: usize, of: fn(&Image) -> Tensor<3>) -> f64 {
        let sensor = sensor();
        let mut truth = SensorModel::ideal(sensor.rings().len());
        truth.terms[0] = truth.terms[0].clone().at(&[0.02, 0.02, 0.05, 1e-4, 1e-4]);
        truth.terms.push(Term::new(Arc::new(made_up), sensor.rings().len()));
        let data = measured_by(&truth, &sensor);
        let refs: Vec<&Batch> = data.iter().collect();
        let table = SmoothTable::new(made_up.0, covariates, data.iter().map(|batch| &batch.image), knots);
        let ideal = SensorModel::ideal(sensor.rings().len());
        let acts_on = table.about().acts_on;
        let noise = Free::noise(ideal.terms[0].clone(), acts_on);
        let free = [noise, Free::all(Term::new(Arc::new(table), sensor.rings().len()))];
        let model = SensorModel {
            terms: fit(&ideal, &free, &On { batches: &refs, channels: acts_on, scope: Scope::All }, Manner::EXACT)
                .terms,
        };
        let (mut sum, mut rays) = (0.0, 0.0);
        for batch in &data {
            let seen = |model: &SensorModel| of(&model.forward(batch.image.clone()));
            let difference = (seen(&model) - seen(&truth)).square() * batch.image.surface.hit.clone();
            sum += numbers(&difference).iter().map(|d| f64::from(*d)).sum::<f64>();
            rays += numbers(&batch.image.surface.hit).iter().map(|h| f64::from(*h)).sum::<f64>();
        }
        let left: f64 = sum / rays;
        left.sqrt()
    }

    #[test]
    fn a_table_over_the_sweep_finds_a_bias_without_a_name() {
        let ramp = |image: &Image| (image.rays.phase.clone() * 6.0).sin() * 0.1;
        let left = error_left(MadeUp(Target::Range, ramp), &[Covariate::SweepPhase], 12, |i| i.report.range_m.clone());
        // The bias has a root mean square of 0.07 m; straight lines between 12 knots stay within 0.004 m of it.
        assert!(left < 0.005, "{left} m left");
    }

    #[test]
    fn a_table_around_the_sensor_has_no_seam() {
        let wave = |image: &Image| image.rays.azimuth_rad.clone().cos() * 0.1;
        let of = |image: &Image| image.report.reflectance.clone();
        let left = error_left(MadeUp(Target::Reflectance, wave), &[Covariate::Azimuth], 12, of);
        assert!(left < 0.006, "{left} left");
    }

    #[test]
    fn a_table_over_two_covariates_finds_where_returns_go_missing() {
        let corner = |image: &Image| {
            let high = image.rays.ring.clone().lower_elem(8.0).float();
            high * image.surface.range_m.clone().greater_elem(15.0).float() * -0.5 + 1.0
        };
        let of = |image: &Image| image.report.keep.clone();
        let left = error_left(MadeUp(Target::Missing, corner), &[Covariate::Ring, Covariate::Range], 8, of);
        assert!(left < 0.12, "{left} of keep left, of a step of 0.5");
    }

    #[test]
    fn every_value_is_shared_by_two_knots_at_most_and_none_is_lost() {
        for covariate in [Covariate::Range, Covariate::Azimuth] {
            let knots = covariate.knots((0..500).map(|i| (i * i) as f32 * 1e-3).collect(), 7);
            let axis = Axis { covariate, knots };
            let x: Vec<f32> = (0..400).map(|i| (i as f32 - 200.0) * 0.9).collect();
            let hats = axis.hats(&Tensor::<1>::from_floats(x.as_slice(), &Device::flex()).reshape([1, 1, 400]));
            let n = hats.dims()[1];
            for row in hats.into_data().iter::<f32>().collect::<Vec<_>>().chunks(n) {
                assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-5 && row.iter().filter(|h| **h > 0.0).count() <= 2);
            }
        }
    }

    #[test]
    fn a_name_is_the_same_text_every_time() {
        let axes = vec![Axis { covariate: Covariate::Class, knots: vec![0.0, 3.0] }];
        let [a, b] = [0, 1].map(|_| SmoothTable::on(Target::Range, axes.clone()).about().name);
        assert_eq!(a, "smooth_table_range_by_class");
        assert!(std::ptr::eq(a, b));
    }
}
