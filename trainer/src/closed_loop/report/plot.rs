//! A curve as a drawing (SVG): means with intervals without and with an effect, and the effect's own.

use std::fmt::Write as _;

use crate::closed_loop::screen::{EffectCurve, Piece, unit};
use crate::effects::Covariate;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 300.0;
/// Left, right, top, bottom of the frame within the drawing.
const FRAME: [f64; 4] = [70.0, 704.0, 14.0, 246.0];

/// From numbers to places.
struct Axes {
    x: (f64, f64),
    y: (f64, f64),
}

impl Axes {
    fn x(&self, x: f64) -> f64 {
        FRAME[0] + (x - self.x.0) / (self.x.1 - self.x.0) * (FRAME[1] - FRAME[0])
    }

    fn y(&self, y: f64) -> f64 {
        let y = y.clamp(self.y.0, self.y.1);
        FRAME[3] - (y - self.y.0) / (self.y.1 - self.y.0) * (FRAME[3] - FRAME[2])
    }
}

/// Draws the curve of an effect.
pub(super) fn curve(curve: &EffectCurve) -> String {
    let pieces: Vec<&Piece> = curve.pieces.iter().filter(|p| p.without.value.is_finite()).collect();
    let Some(axes) = axes(&pieces, curve.covariate) else { return String::new() };
    let mut svg = format!(r#"<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" class="plot">"#);
    grid(&mut svg, &axes, curve);
    let at = |p: &Piece| middle(p, curve.covariate);
    let mut line = String::new();
    for p in &pieces {
        let _ = write!(line, "{:.1},{:.1} ", axes.x(at(p)), axes.y(p.effect));
    }
    let _ = write!(svg, r#"<polyline class="effect" points="{}"/>"#, line.trim_end());
    for (class, aside, of) in
        [("without", -2.5, &(|p: &Piece| p.without) as &dyn Fn(&Piece) -> _), ("with", 2.5, &|p: &Piece| p.with)]
    {
        for p in &pieces {
            let interval = of(p);
            let (x, y) = (axes.x(at(p)) + aside, axes.y(interval.value));
            let (low, high) = (axes.y(interval.ci95[0]), axes.y(interval.ci95[1]));
            let _ = write!(
                svg,
                r#"<g class="{class}"><line x1="{x:.1}" x2="{x:.1}" y1="{low:.1}" y2="{high:.1}"/><circle cx="{x:.1}" cy="{y:.1}" r="3.2"/></g>"#
            );
        }
    }
    svg.push_str("</svg>");
    svg
}

/// Axes that hold every value and the zero; intervals may be cut.
fn axes(pieces: &[&Piece], covariate: Covariate) -> Option<Axes> {
    let values = pieces.iter().flat_map(|p| [p.without.value, p.with.value, p.effect]).chain([0.0]);
    let (low, high) = extent(values)?;
    let room = 0.12 * (high - low).max(1e-9);
    let x = extent(pieces.iter().map(|p| middle(p, covariate)))?;
    let aside = 0.03 * (x.1 - x.0).max(1e-6);
    Some(Axes { x: (x.0 - aside, x.1 + aside), y: (low - room, high + room) })
}

fn grid(svg: &mut String, axes: &Axes, curve: &EffectCurve) {
    let [left, right, top, bottom] = FRAME;
    for y in ticks(axes.y) {
        let at = axes.y(y);
        let class = if y == 0.0 { "zero" } else { "grid" };
        let _ = write!(svg, r#"<line class="{class}" x1="{left}" x2="{right}" y1="{at:.1}" y2="{at:.1}"/>"#);
        let _ = write!(svg, r#"<text x="{}" y="{:.1}" text-anchor="end">{}</text>"#, left - 8.0, at + 4.0, tick(y));
    }
    let logarithmic = is_logarithmic(curve.covariate);
    for x in if logarithmic { decades(axes.x) } else { ticks(axes.x) } {
        let at = axes.x(x);
        let shown = tick(if logarithmic { x.exp() } else { x });
        let _ = write!(svg, r#"<line class="grid" x1="{at:.1}" x2="{at:.1}" y1="{top}" y2="{bottom}"/>"#);
        let _ = write!(svg, r#"<text x="{at:.1}" y="{}" text-anchor="middle">{shown}</text>"#, bottom + 18.0);
    }
    let (x, y) = (f64::midpoint(left, right), f64::midpoint(top, bottom));
    let _ = write!(svg, r#"<text x="{x}" y="{}" text-anchor="middle">{}</text>"#, HEIGHT - 12.0, axis(curve.covariate));
    let _ = write!(
        svg,
        r#"<text transform="translate(15 {y}) rotate(-90)" text-anchor="middle">{}</text>"#,
        unit(curve.channel)
    );
}

/// Middle of a piece; lengths by their logarithm.
fn middle(p: &Piece, covariate: Covariate) -> f64 {
    let middle = f64::midpoint(p.from, p.to);
    if is_logarithmic(covariate) { middle.max(1e-3).ln() } else { middle }
}

/// Whether a covariate spans decades.
fn is_logarithmic(covariate: Covariate) -> bool {
    matches!(covariate, Covariate::Range | Covariate::DepthJump)
}

/// A covariate with its unit.
fn axis(covariate: Covariate) -> String {
    let unit = match covariate {
        Covariate::Azimuth | Covariate::Incidence | Covariate::BrightDistance => "°",
        Covariate::Range | Covariate::Height | Covariate::DepthJump => "m",
        Covariate::Ring => "0 = top",
        Covariate::SweepPhase => "share of the turn",
        _ => "",
    };
    let name = covariate.name().replace('_', " ");
    if unit.is_empty() { name } else { format!("{name} ({unit})") }
}

/// Some five round numbers within.
pub(in crate::closed_loop) fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let rough = (high - low) / 5.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= rough).unwrap_or(rough);
    let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
    (first..=last).map(|k| k as f64 * step).collect()
}

/// Logarithms of 1, 2 and 5 times powers of ten within; of the powers alone where these are enough.
pub(in crate::closed_loop) fn decades((low, high): (f64, f64)) -> Vec<f64> {
    let steps: &[f64] = if high - low > 5.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let all = (-4..5).flat_map(|power| steps.iter().map(move |m| (m * 10f64.powi(power)).ln()));
    all.filter(|x| (low..=high).contains(x)).collect()
}

pub(in crate::closed_loop) fn tick(x: f64) -> String {
    let rounded = (x * 1e6).round() / 1e6;
    format!("{rounded}").replace('-', "−")
}

pub(in crate::closed_loop) fn extent(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values
        .filter(|v| v.is_finite())
        .fold(None, |found, v| Some(found.map_or((v, v), |(low, high): (f64, f64)| (low.min(v), high.max(v)))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(ticks((-0.13, 0.32)), [-0.1, 0.0, 0.1, 0.2, 0.300_000_000_000_000_04]);
        assert_eq!(ticks((0.0, 63.0)), [0.0, 20.0, 40.0, 60.0]);
        assert_eq!(tick(0.300_000_000_000_000_04), "0.3");
        let ranges: Vec<String> = decades((3f64.ln(), 80f64.ln())).into_iter().map(|x| tick(x.exp())).collect();
        assert_eq!(ranges, ["5", "10", "20", "50"]);
        assert_eq!(decades((0.002f64.ln(), 8f64.ln())).len(), 3);
    }
}
