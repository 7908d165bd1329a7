//! Both halves over a covariate, as a drawing (SVG).

use std::fmt::Write as _;

use super::{axis, compared};
use crate::closed_loop::report::plot::{decades, extent, tick, ticks};
use crate::closed_loop::unpaired::{Over, Point, Tried};

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 704.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 246.0;

/// From numbers to places.
struct Scale {
    from: (f64, f64),
    to: (f64, f64),
}

impl Scale {
    fn at(&self, x: f64) -> f64 {
        let share = (x.clamp(self.from.0, self.from.1) - self.from.0) / (self.from.1 - self.from.0);
        self.to.0 + share * (self.to.1 - self.to.0)
    }
}

/// Draws what was tried; nothing where fewer than two points are known.
pub(super) fn curve(tried: &Tried) -> String {
    let points = &tried.curve.points;
    let logarithmic = tried.over == Over::Range;
    let place = |p: &Point| if logarithmic { p.at.ln() } else { p.at };
    let neutral = if tried.over == Over::Power { 0.0 } else { 1.0 };
    let values = points.iter().flat_map(|p| [p.simulated.value, p.measured.value]).chain([neutral]);
    let (Some(along), Some(values)) = (extent(points.iter().map(place)), extent(values)) else { return String::new() };
    if along.1 <= along.0 {
        return String::new();
    }
    let (aside, room) = (0.03 * (along.1 - along.0), 0.12 * (values.1 - values.0).max(1e-3));
    let x = Scale { from: (along.0 - aside, along.1 + aside), to: (LEFT, RIGHT) };
    let y = Scale { from: (values.0 - room, values.1 + room), to: (BOTTOM, TOP) };
    let mut svg = format!(r#"<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" class="plot">"#);
    for value in ticks(y.from) {
        let at = y.at(value);
        let class = if (value - neutral).abs() < 1e-9 { "zero" } else { "grid" };
        let _ = write!(svg, r#"<line class="{class}" x1="{LEFT}" x2="{RIGHT}" y1="{at:.1}" y2="{at:.1}"/>"#);
        let _ = write!(svg, r#"<text x="{}" y="{:.1}" text-anchor="end">{}</text>"#, LEFT - 8.0, at + 4.0, tick(value));
    }
    for value in if logarithmic { decades(x.from) } else { ticks(x.from) } {
        let at = x.at(value);
        let shown = tick(if logarithmic { value.exp() } else { value });
        let _ = write!(svg, r#"<line class="grid" x1="{at:.1}" x2="{at:.1}" y1="{TOP}" y2="{BOTTOM}"/>"#);
        let _ = write!(svg, r#"<text x="{at:.1}" y="{}" text-anchor="middle">{shown}</text>"#, BOTTOM + 18.0);
    }
    let middle = (f64::midpoint(LEFT, RIGHT), f64::midpoint(TOP, BOTTOM));
    let _ = write!(
        svg,
        r#"<text x="{}" y="{}" text-anchor="middle">{}</text><text transform="translate(15 {}) rotate(-90)" text-anchor="middle">{}</text>"#,
        middle.0,
        HEIGHT - 12.0,
        axis(tried.over),
        middle.1,
        compared(tried.over)
    );
    for point in points {
        for (class, aside, interval) in [("with", -2.5, point.simulated), ("without", 2.5, point.measured)] {
            let (px, py) = (x.at(place(point)) + aside, y.at(interval.value));
            let (low, high) = (y.at(interval.ci95[0]), y.at(interval.ci95[1]));
            let _ = write!(
                svg,
                r#"<g class="{class}"><line x1="{px:.1}" x2="{px:.1}" y1="{low:.1}" y2="{high:.1}"/><circle cx="{px:.1}" cy="{py:.1}" r="3.2"/></g>"#
            );
        }
    }
    svg.push_str("</svg>");
    svg
}
