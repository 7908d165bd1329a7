//! Checks that each effect does the same in an exported file as in a fit.

use std::sync::Arc;

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData, s};
use onnx::{Axis, Exporter};

use super::covariate::Covariate;
use super::trial::{measured_by, sensor};
use super::{Effect, Image, Rays, Simulated, SmoothTable, Target, library};
use crate::closed_loop::model::{SensorModel, Term};

/// A module without parameters.
#[derive(Module, Debug)]
struct Nothing {}

/// A drawn scan `[batch, 3, ring, column]` (range, reflectance, probability of a return) from a simulated one (range, reflectance, class).
fn scan(model: &SensorModel, simulated: &Tensor<4>) -> Tensor<4> {
    let channel = |i: i64| simulated.clone().slice(s![.., i..i + 1, .., ..]).squeeze_dim::<3>(1);
    let range_m = channel(0);
    let frame = range_m.clone().slice(s![.., 0..1, 0..1]) * 0.0 + 3.0;
    let keep = range_m.ones_like();
    let simulated = Simulated { range_m, reflectance: channel(1), class: channel(2), keep, frame };
    let device = simulated.range_m.device();
    let image = Image::new(simulated, Rays::new(&sensor(), &device));
    let noise = [0.3, 0.6, 0.9, 0.2].map(|u| image.surface.range_m.zeros_like() + u);
    let drawn = model.forward(image).draw(noise);
    Tensor::stack(vec![drawn.range_m, drawn.reflectance, drawn.keep], 1)
}

#[test]
fn every_effect_does_the_same_in_onnx_runtime() {
    let device = Device::flex();
    let rings = sensor().rings().len();
    let street = &measured_by(&SensorModel::ideal(rings), &sensor())[0];
    let channel = |x: &Tensor<3>| x.clone().inner().to_device(&device);
    let surface = &street.image.surface;
    let input =
        Tensor::stack::<4>(vec![channel(&surface.range_m), channel(&surface.reflectance), channel(&surface.class)], 1);
    let table = |target, covariates: &[Covariate]| -> Arc<dyn Effect> {
        Arc::new(SmoothTable::new(target, covariates, [&street.image], 6))
    };
    let mut effects = library();
    effects.extend(Covariate::ALL.map(|covariate| table(Target::Range, &[covariate])));
    effects.push(table(Target::Missing, &[Covariate::Azimuth, Covariate::Range]));
    for effect in effects {
        let mut term = Term::new(effect, rings);
        term.fitted.iter_mut().enumerate().for_each(|(i, x)| *x = 0.5 + (i % 5) as f64 * 0.3);
        let mut model = SensorModel::ideal(rings);
        model.terms.push(term);
        let file = Exporter::new()
            .input("simulated")
            .output("measured")
            .dynamic(Axis::new("batch", 2).on("simulated", 0))
            .export(
                &Nothing {},
                |sizes| Tensor::<4>::zeros([sizes["batch"], 3, rings, sensor().columns()], &device),
                |_, simulated| scan(&model, &simulated),
            )
            .unwrap_or_else(|error| panic!("{}: {error}", model.terms[1].name()));
        let expected: Vec<f32> = scan(&model, &input).into_data().iter().collect();
        let found = run(&file, &input);
        let far = expected.iter().zip(&found).filter(|(e, f)| (*e - *f).abs() > 1e-3 * (1.0 + e.abs())).count();
        // Rounding may decide otherwise at edges: whether three pixels lie on one plane, on which side of a threshold a target lies.
        assert!(far * 500 < expected.len(), "{}: {far} of {} differ", model.terms[1].name(), expected.len());
    }
}

fn run(file: &[u8], input: &Tensor<4>) -> Vec<f32> {
    let mut session = runtime::open(&runtime::environment().unwrap(), file, 1).unwrap();
    let numbers: Vec<f32> = TensorData::iter::<f32>(&input.clone().into_data()).collect();
    let input = ort::value::Tensor::from_array((input.dims().to_vec(), numbers)).unwrap();
    let outputs = session.run(ort::inputs!["simulated" => input]).unwrap();
    outputs["measured"].try_extract_tensor::<f32>().unwrap().1.to_vec()
}
