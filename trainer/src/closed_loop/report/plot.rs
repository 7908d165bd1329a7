//! Curves as drawings (SVG): values with intervals over a covariate.

use std::fmt::Write as _;

use crate::closed_loop::outcome::Interval;
use crate::closed_loop::screen::{EffectCurve, Piece, unit};
use crate::effects::Covariate;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 300.0;
/// Left, right, top, bottom of the frame within the drawing.
const FRAME: [f64; 4] = [70.0, 704.0, 14.0, 246.0];

/// A frame with two axes, and what is drawn in it.
pub(in crate::closed_loop) struct Plot {
    x: (f64, f64),
    y: (f64, f64),
    svg: String,
}

/// What the axes of a plot say.
pub(in crate::closed_loop) struct Axes<'a> {
    /// Below the horizontal one.
    pub(in crate::closed_loop) along: &'a str,
    /// Beside the vertical one.
    pub(in crate::closed_loop) up: &'a str,
    /// Whether places along are logarithms.
    pub(in crate::closed_loop) logarithmic: bool,
    /// The value that stands for no difference.
    pub(in crate::closed_loop) neutral: f64,
}

impl Plot {
    /// An empty one that has room for these places along and values up; `None` where there is nothing to draw.
    pub(in crate::closed_loop) fn new(
        along: impl Iterator<Item = f64>,
        up: impl Iterator<Item = f64>,
        axes: &Axes<'_>,
    ) -> Option<Self> {
        let (x, y) = (extent(along)?, extent(up.chain([axes.neutral]))?);
        let (aside, room) = (0.03 * (x.1 - x.0).max(1e-6), 0.12 * (y.1 - y.0).max(1e-9));
        let mut plot = Self {
            x: (x.0 - aside, x.1 + aside),
            y: (y.0 - room, y.1 + room),
            svg: format!(r#"<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" class="plot">"#),
        };
        plot.grid(axes);
        Some(plot)
    }

    fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let y = y.clamp(self.y.0, self.y.1);
        (
            FRAME[0] + (x - self.x.0) / (self.x.1 - self.x.0) * (FRAME[1] - FRAME[0]),
            FRAME[3] - (y - self.y.0) / (self.y.1 - self.y.0) * (FRAME[3] - FRAME[2]),
        )
    }

    fn grid(&mut self, axes: &Axes<'_>) {
        let [left, right, top, bottom] = FRAME;
        for y in ticks(self.y) {
            let (_, at) = self.at(self.x.0, y);
            let class = if (y - axes.neutral).abs() < 1e-9 { "zero" } else { "grid" };
            let _ = write!(self.svg, r#"<line class="{class}" x1="{left}" x2="{right}" y1="{at:.1}" y2="{at:.1}"/>"#);
            let _ = write!(
                self.svg,
                r#"<text x="{}" y="{:.1}" text-anchor="end">{}</text>"#,
                left - 8.0,
                at + 4.0,
                tick(y)
            );
        }
        for x in if axes.logarithmic { decades(self.x) } else { ticks(self.x) } {
            let (at, _) = self.at(x, self.y.0);
            let shown = tick(if axes.logarithmic { x.exp() } else { x });
            let _ = write!(self.svg, r#"<line class="grid" x1="{at:.1}" x2="{at:.1}" y1="{top}" y2="{bottom}"/>"#);
            let _ = write!(self.svg, r#"<text x="{at:.1}" y="{}" text-anchor="middle">{shown}</text>"#, bottom + 18.0);
        }
        let (x, y) = (f64::midpoint(left, right), f64::midpoint(top, bottom));
        let _ = write!(self.svg, r#"<text x="{x}" y="{}" text-anchor="middle">{}</text>"#, HEIGHT - 12.0, axes.along);
        let _ = write!(
            self.svg,
            r#"<text transform="translate(15 {y}) rotate(-90)" text-anchor="middle">{}</text>"#,
            axes.up
        );
    }

    /// Draws a line through places.
    pub(in crate::closed_loop) fn line(&mut self, class: &str, through: impl Iterator<Item = (f64, f64)>) {
        let points: Vec<String> = through
            .map(|(x, y)| {
                let (x, y) = self.at(x, y);
                format!("{x:.1},{y:.1}")
            })
            .collect();
        let _ = write!(self.svg, r#"<polyline class="{class}" points="{}"/>"#, points.join(" "));
    }

    /// Draws a value with its interval, `aside` units of the drawing to the right.
    pub(in crate::closed_loop) fn value(&mut self, class: &str, x: f64, aside: f64, value: &Interval) {
        let (x, y) = self.at(x, value.value);
        let [low, high] = value.ci95.map(|end| self.at(0.0, end).1);
        let x = x + aside;
        let _ = write!(
            self.svg,
            r#"<g class="{class}"><line x1="{x:.1}" x2="{x:.1}" y1="{low:.1}" y2="{high:.1}"/><circle cx="{x:.1}" cy="{y:.1}" r="3.2"/></g>"#
        );
    }

    /// The drawing.
    pub(in crate::closed_loop) fn svg(self) -> String {
        self.svg + "</svg>"
    }
}

/// Draws the curve of an effect.
pub(super) fn curve(curve: &EffectCurve) -> String {
    let pieces: Vec<&Piece> = curve.pieces.iter().filter(|p| p.without.value.is_finite()).collect();
    let at = |p: &Piece| middle(p, curve.covariate);
    let axes = Axes {
        along: &axis(curve.covariate),
        up: unit(curve.channel),
        logarithmic: is_logarithmic(curve.covariate),
        neutral: 0.0,
    };
    let values = pieces.iter().flat_map(|p| [p.without.value, p.with.value, p.effect]);
    let Some(mut plot) = Plot::new(pieces.iter().map(|p| at(p)), values, &axes) else { return String::new() };
    plot.line("effect", pieces.iter().map(|p| (at(p), p.effect)));
    for p in &pieces {
        plot.value("without", at(p), -2.5, &p.without);
    }
    for p in &pieces {
        plot.value("with", at(p), 2.5, &p.with);
    }
    plot.svg()
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
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let rough = (high - low) / 5.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= rough).unwrap_or(rough);
    let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
    (first..=last).map(|k| k as f64 * step).collect()
}

/// Logarithms of 1, 2 and 5 times powers of ten within; of the powers alone where these are enough.
fn decades((low, high): (f64, f64)) -> Vec<f64> {
    let steps: &[f64] = if high - low > 5.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let all = (-4..5).flat_map(|power| steps.iter().map(move |m| (m * 10f64.powi(power)).ln()));
    all.filter(|x| (low..=high).contains(x)).collect()
}

fn tick(x: f64) -> String {
    let rounded = (x * 1e6).round() / 1e6;
    format!("{rounded}").replace('-', "−")
}

fn extent(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
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
