//! Whether a measured scan shows what its simulated twin shows, seen from the same side.
//!
//! Sensors err by centimetres and tenths of degrees, drop half of their rays and invent some; none of this may count. What counts is
//! gross: another unit, left and right exchanged, a turned frame, another place.

use std::path::PathBuf;

use lidar::RangeImage;

use super::units::{quantile, strided, unit};
use super::{Defect, DefectKind, Frame, SetError};

/// Least share of pixels on which both have a return.
const MIN_OVERLAP: f64 = 0.01;

/// A frame turned by less may be a mount's yaw, which is an effect to be found.
const MAX_TURN_DEG: f64 = 15.0;

/// From this share of pixels on that agree, nothing is turned or mirrored.
const AGREEING: f64 = 0.95;

/// From this share on a measured scan is likely to show what the simulated one does.
const LIKELY: f64 = 0.8;

/// Frames that are turned and mirrored in search of a better fit.
const MAX_TURNED_FRAMES: usize = 4;

/// Turns that are tried.
const MAX_TURNS: usize = 720;

/// Other frames that a frame is compared with.
const MAX_OTHERS: usize = 8;

/// Pixels on which two simulated scans must differ before they can judge a measured one.
const MIN_JUDGES: usize = 50;

/// Checks all twins; `file` names the measured scan of a frame.
pub(super) fn check(frames: &[Frame], file: &dyn Fn(usize) -> PathBuf) -> Result<(), SetError> {
    for (i, frame) in frames.iter().enumerate() {
        check_overlap(frame, &file(i))?;
    }
    check_scale(frames, file)?;
    check_side(frames, file)?;
    for i in 0..frames.len() {
        check_place(frames, i, file)?;
    }
    Ok(())
}

fn defect(kind: DefectKind, file: PathBuf, found: String, expected: &str, fix: String) -> SetError {
    Box::new(Defect { kind, file, field: "x, y, z", found, expected: expected.into(), fix }).into()
}

fn check_overlap(frame: &Frame, file: &std::path::Path) -> Result<(), SetError> {
    let (simulated, measured) = (frame.simulated.range_m(), frame.measured.range_m());
    let both = simulated.iter().zip(measured).filter(|(s, m)| **s > 0.0 && **m > 0.0).count();
    if both as f64 >= MIN_OVERLAP * simulated.len() as f64 {
        return Ok(());
    }
    Err(defect(
        DefectKind::NoOverlap,
        file.into(),
        format!(
            "no overlap: {both} of {} rays have a return both simulated ({}) and measured ({})",
            simulated.len(),
            frame.simulated.returns(),
            frame.measured.returns()
        ),
        "returns of both on at least 1 % of the rays",
        "Do the two scans belong together?".into(),
    ))
}

/// Refuses measured ranges that are a fixed multiple of the simulated ones: feet, say.
fn check_scale(frames: &[Frame], file: &dyn Fn(usize) -> PathBuf) -> Result<(), SetError> {
    let mut logs: Vec<f32> = Vec::new();
    for frame in frames {
        let pixels = strided(frame.simulated.range_m().len()).filter_map(|i| both(frame, i));
        logs.extend(pixels.map(|(simulated_m, measured_m)| (measured_m / simulated_m).ln()));
    }
    let [low, median, high] = [0.25, 0.5, 0.75].map(|q| quantile(&mut logs, q));
    if median.abs() < 1.5f32.ln() || high - low > 0.1 {
        return Ok(());
    }
    let ratio = median.exp();
    let fix = match unit(ratio) {
        Some((unit, metres)) => format!("It looks like {unit}: multiply x, y, z by {metres}."),
        None => "Store x, y, z in metres.".into(),
    };
    let found =
        format!("ranges are {ratio:.3} times the simulated ones, in nearly all pixels of {} frames", frames.len());
    Err(defect(DefectKind::RangeUnit, file(0), found, "metres", fix))
}

/// Refuses measured scans that fit far better mirrored, or turned about the vertical axis.
fn check_side(frames: &[Frame], file: &dyn Fn(usize) -> PathBuf) -> Result<(), SetError> {
    let some = frames.iter().step_by(frames.len().div_ceil(MAX_TURNED_FRAMES));
    let some: Vec<_> = some.map(|frame| (&frame.simulated, &frame.measured)).collect();
    let columns = some[0].0.columns();
    let straight = agreement(&some, false, 0);
    if straight > AGREEING {
        return Ok(());
    }
    let mut best = (straight, false, 0);
    for mirrored in [false, true] {
        for turn in (0..columns).step_by(columns.div_ceil(MAX_TURNS)) {
            let found = agreement(&some, mirrored, turn);
            if found > best.0 {
                best = (found, mirrored, turn);
            }
        }
    }
    let (found, mirrored, turn) = best;
    let turn_deg = 360.0 * turn as f64 / columns as f64;
    let turn_deg = if turn_deg > 180.0 { turn_deg - 360.0 } else { turn_deg };
    if 1.0 - found > 0.5 * (1.0 - straight) || (!mirrored && turn_deg.abs() < MAX_TURN_DEG) {
        return Ok(());
    }
    let shares = format!("{:.0} % of the ranges agree with the simulated ones", 100.0 * straight);
    let expected = "x ahead, y to the left, z up, as in the simulated scans";
    if !mirrored {
        let found = format!("{shares}, but {:.0} % if the scan is turned by {turn_deg:.0}° to the left", 100.0 * found);
        let fix = format!("Turn the measured scans by {turn_deg:.0}° about z, or the simulated ones back.");
        return Err(defect(DefectKind::Turned, file(0), found, expected, fix));
    }
    let found = format!(
        "left-handed: {shares}, but {:.0} % if the scan is mirrored (y to −y){}",
        100.0 * found,
        if turn_deg.abs() < MAX_TURN_DEG {
            String::new()
        } else {
            format!(" and turned by {turn_deg:.0}° to the left")
        }
    );
    let fix = match turn_deg.abs() {
        ..MAX_TURN_DEG => "Change the sign of y in one of the two halves.",
        ..=135.0 => "Are x and y exchanged? Change the axes of one of the two halves.",
        _ => "Change the sign of x in one of the two halves.",
    };
    Err(defect(DefectKind::LeftHanded, file(0), found, expected, fix.into()))
}

/// Share of the common pixels of simulated and measured scans whose ranges agree once the measured scan is mirrored and then turned by `turn` columns to the left.
fn agreement(pairs: &[(&RangeImage, &RangeImage)], mirrored: bool, turn: usize) -> f64 {
    let (mut both, mut agree) = (0u32, 0u32);
    for (simulated, measured) in pairs {
        let columns = simulated.columns();
        let (simulated, measured) = (simulated.range_m(), measured.range_m());
        for pixel in strided(measured.len()) {
            let (ring, column) = (pixel / columns, pixel % columns);
            let column = if mirrored { columns - 1 - column } else { column };
            // Columns count clockwise: to the left is towards lower ones.
            let simulated_m = simulated[ring * columns + (column + columns - turn) % columns];
            if simulated_m > 0.0 && measured[pixel] > 0.0 {
                both += 1;
                agree += u32::from((measured[pixel] - simulated_m).abs() <= tolerance_m(simulated_m));
            }
        }
    }
    f64::from(agree) / f64::from(both.max(1))
}

/// Refuses a measured scan that fits the simulated scans of other frames as well as its own.
///
/// Only pixels speak on which the two simulated scans differ by much more than any effect makes of a range.
fn check_place(frames: &[Frame], i: usize, file: &dyn Fn(usize) -> PathBuf) -> Result<(), SetError> {
    let others = || (0..frames.len()).filter(|j| *j != i);
    let some = others().step_by(others().count().div_ceil(MAX_OTHERS).max(1));
    let neighbours = [i.wrapping_sub(1), i + 1].into_iter().filter(|j| *j < frames.len());
    let (mut own, mut all, mut suspect) = (0, 0, false);
    for j in some.chain(neighbours) {
        let (nearer_own, judges) = votes(&frames[i], &frames[j].simulated);
        suspect |= judges >= MIN_JUDGES && nearer_own * 4 < judges;
        own += nearer_own;
        all += judges;
    }
    if all < MIN_JUDGES {
        return check_alone(&frames[i], file(i));
    }
    if !suspect && own * 5 >= all * 3 {
        return Ok(());
    }
    let share = |j: usize| {
        let (own, judges) = votes(&frames[i], &frames[j].simulated);
        if judges >= MIN_JUDGES { own as f64 / judges as f64 } else { 1.0 }
    };
    let likely = |j: usize| agreement(&[(&frames[j].simulated, &frames[i].measured)], false, 0) > LIKELY;
    let best = others().map(|j| (share(j), j)).min_by(|a, b| a.0.total_cmp(&b.0));
    let best = best.filter(|(share, j)| *share < 0.25 && likely(*j));
    let fix = match best {
        Some((_, j)) => {
            format!("It fits the simulated scan of frame {} far better: are the frames numbered alike?", frames[j].name)
        }
        None => "Do the two scans belong together: the same scene, pose and time?".into(),
    };
    Err(defect(
        DefectKind::NoOverlap,
        file(i),
        format!(
            "where the simulated scans differ, {:.0} % of the measured ranges are nearer to those of its own frame than to those of others",
            100.0 * own as f64 / all as f64
        ),
        "the scene that the simulated scan of the same name shows",
        fix,
    ))
}

/// Pixels on which `other` differs from the frame's own simulated scan, and how many of them are measured nearer to its own.
fn votes(frame: &Frame, other: &RangeImage) -> (usize, usize) {
    let (mut own, mut judges) = (0, 0);
    for i in strided(other.range_m().len()) {
        let other_m = other.range_m()[i];
        let Some((simulated_m, measured_m)) = both(frame, i) else { continue };
        if other_m > 0.0 && (other_m - simulated_m).abs() > 3.0 * tolerance_m(other_m.min(simulated_m)) {
            judges += 1;
            own += usize::from((measured_m - simulated_m).abs() < (measured_m - other_m).abs());
        }
    }
    (own, judges)
}

/// Judges a frame that there is nothing to compare with.
fn check_alone(frame: &Frame, file: PathBuf) -> Result<(), SetError> {
    let agree = agreement(&[(&frame.simulated, &frame.measured)], false, 0);
    let pixels = strided(frame.simulated.range_m().len()).filter_map(|i| both(frame, i));
    let mut off_m: Vec<f32> = pixels.map(|(s, m)| (m - s).abs()).collect();
    let median_m = quantile(&mut off_m, 0.5);
    if agree >= 0.1 || median_m < 2.0 {
        return Ok(());
    }
    let found = format!(
        "{:.0} % of the ranges agree with the simulated ones, half are more than {median_m:.1} m off",
        100.0 * agree
    );
    let fix = "Do the two scans belong together: the same scene, pose and time?".into();
    Err(defect(DefectKind::NoOverlap, file, found, "the scene that the simulated scan of the same name shows", fix))
}

/// Simulated and measured range of a pixel where both have a return.
fn both(frame: &Frame, i: usize) -> Option<(f32, f32)> {
    let (simulated_m, measured_m) = (frame.simulated.range_m()[i], frame.measured.range_m()[i]);
    (simulated_m > 0.0 && measured_m > 0.0).then_some((simulated_m, measured_m))
}

/// How far apart ranges of one surface may be: more than any usual range offset, noise or scale.
fn tolerance_m(range_m: f32) -> f32 {
    0.4 + 0.03 * range_m
}
