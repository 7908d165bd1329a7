//! The answer in plain words.

use super::UnpairedReport;
use crate::closed_loop::outcome::Found;
use crate::closed_loop::report::Verdict;
use crate::closed_loop::report::numbers::{chance, digits, length, percent, with_error};
use crate::closed_loop::report::words::found;
use crate::closed_loop::unpaired::detection::TENTH;
use crate::closed_loop::unpaired::{CANNOT_BE_SEEN, Over};

/// The whole answer, a paragraph a line.
pub(super) fn summary(report: &UnpairedReport) -> String {
    let finding = &report.finding;
    let effects = finding.effects();
    let mut lines: Vec<String> = effects.iter().map(|effect| sentence(effect)).collect();
    lines.extend(finding.tried.iter().filter(|tried| tried.found.is_some()).filter_map(|tried| {
        let [before, after] = tried.residual?;
        let what = if tried.over == Over::Power { "the share of missing returns" } else { "ln reflectance" };
        let name = tried.over.effect().replace('_', " ");
        Some(format!(
            "On measured scenes that nothing was fitted on, {name} takes the scatter of {what} within strata from {} to {}.",
            digits(before, 3),
            digits(after, 3)
        ))
    }));
    lines.extend(finding.unexplained().iter().map(|what| {
        format!(
            "Something is missing that has no name here: returns are lost the more the less power is expected of them (range, incidence, \
             reflectance), but by no threshold (q {}).",
            chance(what.q_value)
        )
    }));
    if finding.verdict() == Verdict::NothingMissing {
        lines.push("Nothing is missing of what can be seen without twins.".into());
    }
    let noise = &finding.noise;
    lines.push(format!(
        "The noise floor, as the measured scans show it: {} in range, {} in reflectance, {} of the rays lost.",
        length(noise.range_sigma_m),
        digits(noise.reflectance_sigma, 2),
        percent(noise.drop)
    ));
    let names: Vec<String> = CANNOT_BE_SEEN.iter().map(|unseen| unseen.name.replace('_', " ")).collect();
    lines.push(format!("Scans of different places cannot show: {}.", names.join(", ")));
    lines.extend(finding.caveats.iter().map(|caveat| format!("Note: {caveat}.")));
    lines.join("\n")
}

/// What the sensor does, as a sentence: only with what was fitted.
pub(super) fn sentence(effect: &Found) -> String {
    let physical = effect.term.physical();
    let ties = match effect.ties.as_slice() {
        [] => String::new(),
        ties => format!(" These data cannot tell this from {}.", ties.join(" or ").replace('_', " ")),
    };
    match effect.term.name() {
        "ring_gain" => {
            let known = physical.iter().zip(&effect.stderr).filter(|(_, e)| e.is_finite()).map(|(gain, _)| *gain);
            let (least, most) = known.fold((f64::INFINITY, 0.0_f64), |(a, b), g| (a.min(g), b.max(g)));
            let (least, most) = (digits(least, 2), digits(most, 2));
            format!(
                "The sensor reports reflectance with a gain of its own on every ring, from {least} to {most} of the mean.{ties}"
            )
        }
        "weak_return_drop" => {
            let power = digits(physical[0] * (TENTH * physical[1]).exp(), 2);
            format!(
                "The sensor loses returns of dark, slanted or far surfaces: one in ten at an expected power ρ·cos α/r² of {power} per m².{ties}"
            )
        }
        "reflectance_falloff" if !effect.stderr.get(1).is_some_and(|e| e.is_finite()) => {
            let beta = with_error(physical[0], effect.stderr[0], "");
            format!("The sensor reports reflectance that fades with range, by e^−2·({beta}) a metre.{ties}")
        }
        _ => found(effect),
    }
}
