//! Both halves over a covariate, as a drawing (SVG).

use super::{axis, compared};
use crate::closed_loop::report::plot::{Axes, Plot};
use crate::closed_loop::unpaired::{Over, Point, Tried};

/// Draws what was tried; nothing where no point is known.
pub(super) fn curve(tried: &Tried) -> String {
    let points = &tried.curve.points;
    let logarithmic = tried.over == Over::Range;
    let at = |p: &Point| if logarithmic { p.at.ln() } else { p.at };
    let neutral = if tried.over == Over::Power { 0.0 } else { 1.0 };
    let axes = Axes { along: axis(tried.over), up: compared(tried.over), logarithmic, neutral };
    let values = points.iter().flat_map(|p| [p.simulated.value, p.measured.value]);
    let Some(mut plot) = Plot::new(points.iter().map(at), values, &axes) else { return String::new() };
    for point in points {
        plot.value("with", at(point), -2.5, &point.simulated);
        plot.value("without", at(point), 2.5, &point.measured);
    }
    plot.svg()
}
