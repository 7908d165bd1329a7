//! What a sensor does, as a sentence: an effect's own words with the numbers that were found.

use super::numbers::{digits, with_error};
use crate::closed_loop::model::Term;

/// Fills the places of a sentence with what was found, each with its unit, and per-ring numbers by their extremes.
///
/// `{offset_m}` stands for a parameter. `{higher|lower}` after it is the first word if the number is positive; if it is negative the
/// second, and the number is told without its sign.
pub(super) fn filled(does: &str, term: &Term, stderr: &[f64]) -> String {
    let physical = term.physical();
    let layout = term.layout();
    let mut text = String::new();
    let mut rest = does;
    let mut negative = false;
    while let Some((before, place, after)) = next_place(rest) {
        text.push_str(before);
        rest = after;
        if let Some((up, down)) = place.split_once('|') {
            text.push_str(if negative { down } else { up });
            continue;
        }
        let Some((parameter, range)) = layout.iter().find(|(parameter, _)| parameter.name == place) else { continue };
        let unit = unit(parameter.name, after);
        let [value] = physical[range.clone()] else {
            text.push_str(&extremes(&physical[range.clone()], unit));
            continue;
        };
        let is_signed = next_place(after).is_some_and(|(_, place, _)| place.contains('|'));
        negative = is_signed && value < 0.0;
        let shown = if negative { -value } else { value };
        if parameter.name.ends_with("_ring") {
            // A cast keeps what is below 0 at 0.
            text.push_str(&(shown.round() as usize).min(term.rings() - 1).to_string());
        } else {
            text.push_str(&with_error(shown, stderr.get(range.start).copied().unwrap_or(f64::NAN), unit));
        }
    }
    text + rest
}

/// The text before the next place, what the place is called, and the text after it.
fn next_place(text: &str) -> Option<(&str, &str, &str)> {
    let (before, rest) = text.split_once('{')?;
    let (place, after) = rest.split_once('}')?;
    Some((before, place, after))
}

/// The unit that a parameter's name ends with, unless the words after it say it.
fn unit(name: &str, after: &str) -> &'static str {
    match () {
        () if name.ends_with("_deg_s") => "°/s",
        () if name.ends_with("_m_s") => " m/s",
        () if name.ends_with("_deg") && !after.starts_with('°') => "°",
        () if name.ends_with("_per_m") => "",
        () if name.ends_with("_m") && !after.starts_with(" m") => " m",
        () => "",
    }
}

fn extremes(values: &[f64], unit: &str) -> String {
    let (least, most) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    format!("between {}{unit} and {}{unit}", digits(least, 2), digits(most, 2))
}

#[cfg(test)]
#[allow(clippy::expect_used, reason = "a test that panics is a test that fails")]
mod tests {
    use super::*;
    use crate::effects::library;

    fn said(name: &str, physical: &[f64], stderr: &[f64]) -> String {
        let effect = library().into_iter().find(|e| e.about().name == name).expect("an effect of the library");
        let does = effect.about().does;
        filled(does, &Term::new(effect, 32).at(physical), stderr)
    }

    #[test]
    fn a_negative_number_is_told_by_the_opposite_word() {
        assert_eq!(said("range_offset", &[-0.013], &[0.001]), "reports ranges that are 0.013 m ± 0.002 m too short");
        assert_eq!(said("range_offset", &[0.013], &[0.001]), "reports ranges that are 0.013 m ± 0.002 m too long");
        let moving = said("rolling_shutter", &[8.0, -0.5, -3.0], &[0.1; 3]);
        let expected =
            "moves 8.0 m/s ± 0.2 m/s ahead and 0.5 m/s ± 0.2 m/s to the right and turns 3.0°/s ± 0.2°/s to the right";
        assert!(moving.starts_with(expected), "{moving}");
    }

    #[test]
    fn rings_are_whole_numbers() {
        let blocked = said("blocked_sector", &[84.0, 144.0, 0.28, -1.8, 64.0], &[0.3, 0.3, 0.01, 0.6, 33.0]);
        assert!(blocked.contains("rings 0 to 31,"), "{blocked}");
    }

    #[test]
    fn every_effect_says_what_it_does_without_a_place_left_open() {
        for effect in library() {
            let does = effect.about().does;
            let term = Term::new(effect, 4);
            let said = filled(does, &term, &vec![0.1; term.fitted.len()]);
            assert!(!said.is_empty() && !said.contains(['{', '}', '|']), "{}: {said}", term.name());
            let mut rest = does;
            while let Some((_, place, after)) = next_place(rest) {
                assert!(
                    place.contains('|') || term.parameters.iter().any(|p| p.name == place),
                    "{}: no parameter {place}",
                    term.name()
                );
                rest = after;
            }
        }
    }
}
