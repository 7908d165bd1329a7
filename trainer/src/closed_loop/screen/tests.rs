#![allow(clippy::expect_used, reason = "a test that panics is a test that fails")]

use burn::tensor::{Tensor, TensorData};

use super::*;
use crate::closed_loop::likelihood::Observed;
use crate::closed_loop::model::Term;
use crate::effects::library;
use crate::effects::trial::{measured_by, sensor};

const RINGS: usize = 16;
const COLUMNS: usize = 256;

/// A sensor with 2 cm and 0.02 of noise that loses 5 % of its rays.
fn plain() -> SensorModel {
    let mut model = SensorModel::ideal(RINGS);
    model.terms[0] = model.terms[0].clone().at(&[0.02, 0.02, 0.05, 1e-4, 1e-4]);
    model
}

/// Screens the plain model against a plain sensor to whose ranges something of (ring, share of the turn) is added, in m; `None` loses
/// the return.
fn screened(changed: impl Fn(usize, f32) -> Option<f32>) -> Screening {
    let mut batches = measured_by(&plain(), &sensor());
    for batch in &mut batches {
        let size = batch.observed.range_m.dims();
        let range_m: Vec<f32> = batch.observed.range_m.clone().into_data().iter::<f32>().collect();
        let changed = |(i, r): (usize, &f32)| {
            let by = changed(i / COLUMNS % RINGS, (i % COLUMNS) as f32 / COLUMNS as f32);
            if *r > 0.0 { by.map_or(0.0, |by| r + by) } else { 0.0 }
        };
        let range_m: Vec<f32> = range_m.iter().enumerate().map(changed).collect();
        let range_m = Tensor::from_data(TensorData::new(range_m, size), &batch.image.device());
        batch.observed = Observed::new(range_m, batch.observed.reflectance.clone());
    }
    screen(&plain(), &batches.iter().collect::<Vec<_>>(), 1)
}

fn first(screening: &Screening, channel: Channel) -> &Dependence {
    screening.dependences.iter().find(|d| d.channel == channel).expect("an entry a channel")
}

#[test]
fn nothing_depends_on_anything_where_nothing_is_missing() {
    let screening = screened(|_, _| Some(0.0));
    let claimed: Vec<_> = screening.dependences.iter().filter(|d| d.q_value < 0.05 && d.share > 0.01).collect();
    assert!(claimed.is_empty(), "{claimed:?}");
}

#[test]
fn a_gain_of_every_ring_shows_as_reflectance_over_ring() {
    let mut sensor_model = plain();
    let effect = library().into_iter().find(|e| e.about().name == "ring_gain").expect("the effect");
    let gains = (0..RINGS).map(|k| if k % 2 == 0 { 0.8 } else { 1.2 });
    let truth: Vec<f64> = gains.chain((0..RINGS).map(|_| 0.0)).collect();
    sensor_model.terms.push(Term::new(effect, RINGS).at(&truth));
    let batches = measured_by(&sensor_model, &sensor());
    let screening = screen(&plain(), &batches.iter().collect::<Vec<_>>(), 1);
    let ring = first(&screening, Channel::Reflectance);
    assert_eq!(ring.covariates, [Covariate::Ring]);
    assert!(ring.q_value < 0.05 && ring.share > 0.3, "{} {}", ring.q_value, ring.share);
    assert_eq!(ring.curve.len(), RINGS);
    assert!(first(&screening, Channel::Range).share < 0.01);
}

#[test]
fn rays_that_are_lost_in_a_sector_show_as_missing_over_azimuth() {
    let screening = screened(|_, turn| (!(0.3..0.4).contains(&turn)).then_some(0.0));
    let sector = first(&screening, Channel::Missing);
    assert_eq!(sector.covariates, [Covariate::Azimuth]);
    // The first column is at +180°, so a third of the turn is at 180° − 0.35·360° = 54°.
    let lowest = sector.curve.iter().min_by(|a, b| a.mean.total_cmp(&b.mean)).expect("a curve");
    assert!(lowest.from < 54.0 && lowest.to > 36.0 && lowest.mean < -0.9, "{lowest:?}");
}

#[test]
fn a_ramp_with_a_jump_at_the_seam_is_a_matter_of_time_and_a_wave_without_one_of_direction() {
    let ramp = screened(|_, turn| Some(0.04 * (turn - 0.5)));
    assert!(ramp.of(Channel::Range, &[Covariate::SweepPhase]).is_some_and(|d| d.q_value < 0.05));
    assert!(ramp.of(Channel::Range, &[Covariate::Azimuth]).is_none());
    let wave = screened(|_, turn| Some(0.02 * (std::f32::consts::TAU * turn).sin()));
    assert!(wave.of(Channel::Range, &[Covariate::Azimuth]).is_some_and(|d| d.q_value < 0.05));
    assert!(wave.of(Channel::Range, &[Covariate::SweepPhase]).is_none());
}

#[test]
fn what_only_two_covariates_together_explain_is_a_pair() {
    let quarter = |turn: f32| (4.0 * turn) as usize;
    let screening = screened(|ring, turn| Some(if ring % 2 == quarter(turn) % 2 { 0.02 } else { -0.02 }));
    let pair = first(&screening, Channel::Range);
    assert_eq!(pair.covariates, [Covariate::Ring, Covariate::Azimuth]);
    // 2 cm beside 2 cm of noise are half of the variance.
    assert!((pair.share - 0.5).abs() < 0.1, "{}", pair.share);
    let alone = screening.of(Channel::Range, &[Covariate::Azimuth]);
    assert!(alone.is_some_and(|azimuth| azimuth.share < 0.05), "{alone:?}");
}
