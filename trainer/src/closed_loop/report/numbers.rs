//! Numbers as people read them.

use crate::closed_loop::outcome::Interval;

/// Half a 95 % interval, in standard errors.
const HALF: f64 = 1.96;

/// A length: in m, cm or mm, two or three digits.
pub(in crate::closed_loop) fn length(m: f64) -> String {
    let (scaled, unit) = match m.abs() {
        x if x >= 0.995 => (m, "m"),
        x if x >= 0.00995 => (m * 100.0, "cm"),
        _ => (m * 1000.0, "mm"),
    };
    format!("{} {unit}", digits(scaled, if scaled.abs() >= 9.95 { 2 } else { 1 + usize::from(scaled.abs() >= 0.95) }))
}

/// A number with this many significant digits, no exponent where it can be helped.
pub(in crate::closed_loop) fn digits(x: f64, significant: usize) -> String {
    if x == 0.0 || !x.is_finite() {
        return if x == 0.0 { "0".into() } else { "–".into() };
    }
    let magnitude = x.abs().log10().floor() as i32;
    if !(-4..7).contains(&magnitude) {
        return minus(&format!("{x:.*e}", significant.saturating_sub(1)));
    }
    minus(&format!("{x:.*}", (significant as i32 - 1 - magnitude).max(0) as usize))
}

/// A value with its 95 % interval: as many places as the half-width's first digit asks for.
pub(in crate::closed_loop) fn with_error(value: f64, stderr: f64, unit: &str) -> String {
    let half = HALF * stderr;
    if !(half.is_finite() && half > 0.0) {
        return format!("{}{unit}", digits(value, 3));
    }
    // An error of 0.0096 rounds to 0.01: its place is found after rounding.
    let place = format!("{half:.0e}").parse::<f64>().unwrap_or(half).log10().floor() as i32;
    if !(-6..5).contains(&place) {
        return format!("{}{unit} ± {}{unit}", digits(value, 3), digits(half, 1));
    }
    let places = (-place).max(0) as usize;
    minus(&format!("{value:.places$}{unit} ± {half:.places$}{unit}"))
}

/// An interval: value and ends, in one unit.
pub(in crate::closed_loop) fn interval(of: &Interval, show: impl Fn(f64) -> String) -> (String, String) {
    (show(of.value), format!("{} to {}", show(of.ci95[0]), show(of.ci95[1])))
}

/// A gain in nats a ray, per thousand rays.
pub(in crate::closed_loop) fn gain(nats: f64) -> String {
    digits(nats * 1e3, 3)
}

/// A share in percent.
pub(in crate::closed_loop) fn percent(share: f64) -> String {
    match share * 100.0 {
        x if !x.is_finite() => "–".into(),
        x if x.abs() >= 10.0 => minus(&format!("{x:.0} %")),
        x => minus(&format!("{x:.1} %")),
    }
}

/// A probability of chance.
pub(in crate::closed_loop) fn chance(q: f64) -> String {
    if q < 0.001 { "under 0.001".into() } else { format!("{q:.3}") }
}

/// The true minus sign.
fn minus(text: &str) -> String {
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_the_unit_that_people_would_use() {
        let shown = [0.31, 0.0207, 0.001_23, 2.345, -0.05, 0.0].map(length);
        assert_eq!(shown, ["31 cm", "2.1 cm", "1.2 mm", "2.3 m", "−5.0 cm", "0 mm"]);
    }

    #[test]
    fn an_error_decides_how_many_places_are_shown() {
        assert_eq!(with_error(0.2134, 0.004, "°"), "0.213° ± 0.008°");
        assert_eq!(with_error(0.2134, 0.0051, "°"), "0.21° ± 0.01°");
        assert_eq!(with_error(0.2134, 0.0049, "°"), "0.21° ± 0.01°");
        assert_eq!(with_error(-123.4, 7.0, " m"), "−123 m ± 14 m");
        assert_eq!(with_error(0.5, 0.0, ""), "0.500");
    }

    #[test]
    fn small_numbers_keep_their_digits() {
        assert_eq!(digits(0.000_123_4, 3), "0.000123");
        assert_eq!(digits(1234.5, 3), "1234");
        assert_eq!(digits(-0.5, 2), "−0.50");
    }
}
