//! Checks that effects also undo what another program, which writes them down differently, does to a scan.

use std::sync::Arc;

use burn::tensor::Tensor;

use super::trial::{Trial, measured_at_true_angles, sensor};
use super::{About, ActsOn, Channel, Effect, Image, Parameter, Values, library};
use crate::closed_loop::model::{SensorModel, Term};

/// Another way to write an effect: metres that it adds to the range, or a factor of the reflectance.
#[derive(Clone, Copy, Debug)]
struct Form {
    like: &'static str,
    change: Change,
}

#[derive(Clone, Copy, Debug)]
enum Change {
    Longer(fn(&Image) -> Tensor<3>),
    Times(fn(&Image) -> Tensor<3>),
}

impl Effect for Form {
    fn about(&self) -> About {
        About {
            name: "form",
            does: "",
            channel: Channel::Range,
            acts_on: ActsOn::ALL,
            covariates: &[],
            formula: "",
            source: "",
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![]
    }

    fn forward(&self, _: &Values, mut image: Image) -> Image {
        match self.change {
            Change::Longer(metres) => image.report.range_m = image.report.range_m.clone() + metres(&image),
            Change::Times(factor) => image.report.reflectance = image.report.reflectance.clone() * factor(&image),
        }
        image
    }
}

fn reflectance(image: &Image) -> Tensor<3> {
    image.surface.reflectance.clone().clamp(0.02, 1.0)
}

fn range_m(image: &Image) -> Tensor<3> {
    image.surface.range_m.clone().clamp_min(0.1)
}

fn tan(image: &Image) -> Tensor<3> {
    let cosine = image.surface.cos_incidence.clone();
    (cosine.clone().square() * -1.0 + 1.0).clamp_min(0.0).sqrt() / cosine
}

/// Share of the error that the fitted effect of the library takes away, where the image shows at what angle the surface is met.
fn undone(form: Form) -> f64 {
    let rings = sensor().rings().len();
    let mut model = SensorModel::ideal(rings);
    model.terms[0] = model.terms[0].clone().at(&[0.02, 0.02, 0.05, 1e-4, 1e-4]);
    model.terms.push(Term::new(Arc::new(form), rings));
    let data = measured_at_true_angles(&model, &sensor());
    let Some(effect) = library().into_iter().find(|e| e.about().name == form.like) else { return f64::NAN };
    let fitted = Term::new(Arc::clone(&effect), rings).at(&Trial::on(effect, &data).found);
    let (mut before, mut after) = (0.0, 0.0);
    for batch in &data {
        let ideal = batch.image.clone();
        let of = |image: Image| match form.change {
            Change::Longer(_) => image.report.range_m,
            Change::Times(_) => image.report.reflectance,
        };
        let truth = of(form.forward(&Values::new(vec![]), ideal.clone()));
        let error =
            |x: Tensor<3>| -> f64 { ((x - truth.clone()).abs() * ideal.surface.known.clone()).sum().into_scalar() };
        before += error(of(ideal.clone()));
        after += error(of(fitted.forward(ideal.clone())));
    }
    1.0 - after / before
}

#[test]
fn other_forms_of_an_effect_are_undone_too() {
    use Change::{Longer, Times};
    let forms = [
        ("range_walk", 0.98, Longer(|i| reflectance(i).log() * -0.02)),
        ("range_walk", 0.98, Longer(|i| (reflectance(i).sqrt() * -1.0 + 1.0) * 0.06)),
        ("range_walk", 0.98, Longer(|i| (reflectance(i) * -1.0 + 1.0) * 0.06)),
        ("range_walk", 0.98, Longer(|i| (reflectance(i).sqrt().recip() - 1.0) * 0.02)),
        ("range_walk", 0.98, Longer(|i| (reflectance(i).recip() - 1.0) * 0.005)),
        (
            "reflectance_falloff",
            0.92,
            Times(|i| ((range_m(i) * -0.25).exp() * -1.0 + 1.0) * (range_m(i) * -0.01).exp()),
        ),
        (
            "reflectance_falloff",
            0.92,
            Times(|i| range_m(i).square() / (range_m(i).square() + 16.0) * (range_m(i) * -0.01).exp()),
        ),
        ("incidence_falloff", 0.85, Times(|i| i.surface.cos_incidence.clone())),
        ("incidence_falloff", 0.85, Times(|i| i.surface.cos_incidence.clone() * 0.6 + 0.4)),
        ("incidence_stretch", 0.94, Longer(|i| tan(i).clamp_max(5.0) * 0.02)),
        ("incidence_stretch", 0.94, Longer(|i| tan(i) * 0.02)),
        ("incidence_stretch", 0.94, Longer(|i| tan(i).clamp_max(10.0) * range_m(i) * 0.002)),
    ];
    for (n, (like, least, change)) in forms.into_iter().enumerate() {
        let undone = undone(Form { like, change });
        assert!(undone > least, "form {n} of {like}: {undone} undone");
    }
}
