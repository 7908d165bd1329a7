#![allow(clippy::expect_used, reason = "a test that panics is a test that fails")]

use super::*;
use crate::closed_loop::model::Term;
use crate::effects::library;
use crate::effects::trial::{measured_by, sensor};

/// A sensor with 2 cm and 0.02 of noise that loses 5 % of its rays, whose rays point `offset_deg` higher.
fn model(offset_deg: f64) -> SensorModel {
    let rings = sensor().rings().len();
    let mut model = SensorModel::ideal(rings);
    model.terms[0] = model.terms[0].clone().at(&[0.02, 0.02, 0.05, 1e-6, 1e-6]);
    if offset_deg != 0.0 {
        let effect = library().into_iter().find(|e| e.about().name == "elevation_offset").expect("the effect");
        model.terms.push(Term::new(effect, rings).at(&[offset_deg]));
    }
    model
}

#[test]
fn a_true_model_reaches_its_ceiling_and_a_wrong_one_does_not() {
    let (wrong, truth) = (model(0.0), model(0.3));
    let measured = measured_by(&truth, &sensor());
    let batches: Vec<&Batch> = measured.iter().collect();
    let found = confirm(&wrong, &truth, &batches, 1);
    for name in ["range_mae_m", "range_rmse_m", "keep_log_loss", "keep_brier", "reflectance_mae"] {
        let Metric { after, ceiling, .. } = found.of(name).expect("the metric");
        // Some 6000 returns: their mean noise is known to 2 %, and losing 5 % of them to 10 %.
        assert!((after.value / ceiling - 1.0).abs() < 0.1, "{name}: {} of {ceiling}", after.value);
    }
    let range = found.of("range_mae_m").expect("the metric");
    assert!(range.before.value > 3.0 * range.after.value, "{range:?}");
    // Some 6000 returns know their mean to an 80th of their deviation.
    let deviation = found.of("range_rmse_m").expect("the metric").after.value;
    assert!(found.of("range_bias_m").is_some_and(|m| m.after.value.abs() < deviation / 15.0));
    assert!(found.edge_rays.share > 0.001 && found.edge_rays.share < 0.3, "{:?}", found.edge_rays);
    assert!(found.got_worse.is_empty(), "{:?}", found.got_worse);
    let backwards = confirm(&truth, &wrong, &batches, 1);
    assert!(backwards.got_worse.contains(&"range_mae_m"), "{:?}", backwards.got_worse);
}

#[test]
fn a_drawn_scan_has_its_own_noise_on_top() {
    let truth = model(0.0);
    let measured = measured_by(&truth, &sensor());
    let found = confirm(&truth, &truth, &measured.iter().collect::<Vec<_>>(), 1);
    let range = found.of("range_rmse_m").expect("the metric");
    let drawn = range.drawn.expect("a drawn scan has ranges").value;
    assert!((drawn / range.after.value - 2f64.sqrt()).abs() < 0.05, "{drawn} and {}", range.after.value);
    // Two independent scans disagree about a ray with probability 2p(1 − p).
    let keep = found.of("keep_brier").expect("the metric");
    assert!((keep.drawn.expect("and lost rays").value / (2.0 * keep.ceiling) - 1.0).abs() < 0.1, "{keep:?}");
}

#[test]
fn scans_that_were_written_are_judged_like_models() {
    let truth = model(0.0);
    let measured = measured_by(&truth, &sensor());
    let batches: Vec<&Batch> = measured.iter().collect();
    let scans: Vec<RangeImage> = batches
        .iter()
        .flat_map(|b| {
            let median = truth.forward(b.image.clone());
            let dims = b.observed.range_m.dims();
            let (r, i) = (numbers(&median.report.range_m, dims), numbers(&median.report.reflectance, dims));
            let frames = r.chunks(dims[1] * dims[2]).zip(i.chunks(dims[1] * dims[2]));
            let image =
                |(r, i): (&[f32], &[f32])| RangeImage::from_channels(dims[2], r.to_vec(), i.to_vec(), vec![0; r.len()]);
            frames.map(image).collect::<Vec<_>>()
        })
        .collect();
    let of_model = confirm(&truth, &truth, &batches, 1);
    for (name, of_scan) in of_scans(&scans, [&truth, &truth], &batches, 1) {
        if name.starts_with("range") {
            let of_model = of_model.of(name).expect("the metric").after.value;
            assert!((of_scan.value - of_model).abs() < 1e-4, "{name}: {} and {of_model}", of_scan.value);
        }
    }
}
