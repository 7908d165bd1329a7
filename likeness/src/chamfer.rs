//! Chamfer distance: how far two clouds lie apart, point to nearest point.

use crate::metric::Metric;
use crate::nearest::Cloud;
use crate::points::{Point, squared};

/// Of a scan and its simulation.
pub const CHAMFER: Metric = Metric {
    name: "Chamfer distance",
    unit: "m",
    definition: "mean distance from a point to the nearest of the other cloud, both ways averaged; returns of the output against the \
                 simulation's on the same rays; mean over scans",
};

/// ½·(mean over a of min over b of |a − b| + the same the other way round), in the points' unit.
pub fn chamfer(a: &Cloud, b: &Cloud) -> f64 {
    let one_way =
        |from: &Cloud, to: &Cloud| mean(from.points().iter().map(|p| f64::from(to.nearest(p).squared).sqrt()));
    0.5 * (one_way(a, b) + one_way(b, a))
}

/// The same of few points, looked at one by one.
pub fn chamfer_of_few(a: &[Point], b: &[Point]) -> f64 {
    0.5 * both_ways(a, b, f64::sqrt)
}

/// Mean over a of min over b of |a − b|² plus the same the other way round, in the square of the points' unit: Fan et al., "A point set
/// generation network for 3D object reconstruction from a single image" (2017), and what the code of generative models calls Chamfer.
pub fn squared_chamfer_of_few(a: &[Point], b: &[Point]) -> f64 {
    both_ways(a, b, |squared| squared)
}

fn both_ways(a: &[Point], b: &[Point], of_squared: impl Fn(f64) -> f64) -> f64 {
    let (mut to_b, mut to_a) = (vec![f32::INFINITY; a.len()], vec![f32::INFINITY; b.len()]);
    for (p, to_b) in a.iter().zip(&mut to_b) {
        for (q, to_a) in b.iter().zip(&mut to_a) {
            let away = squared(p, q);
            *to_b = to_b.min(away);
            *to_a = to_a.min(away);
        }
    }
    let one_way = |away: Vec<f32>| mean(away.into_iter().map(|squared| of_squared(f64::from(squared))));
    one_way(to_b) + one_way(to_a)
}

/// NaN without numbers.
pub(crate) fn mean(numbers: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = numbers.len() as f64;
    numbers.sum::<f64>() / n
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bev::tests::spiral;

    // scipy: a, b = spiral(40, 0), spiral(30, .3); d = cdist(a, b); ½(d.min(1).mean() + d.min(0).mean());
    // d = cdist(a, b, 'sqeuclidean'); d.min(1).mean() + d.min(0).mean()
    #[test]
    fn distances_are_those_that_scipy_finds() {
        let (a, b) = (spiral(40, 0.0), spiral(30, 0.3));
        assert!((chamfer_of_few(&a, &b) - 6.848_430_386).abs() < 1e-6, "{}", chamfer_of_few(&a, &b));
        assert!((squared_chamfer_of_few(&a, &b) - 119.812_417_951).abs() < 1e-5, "{}", squared_chamfer_of_few(&a, &b));
        let cloud = |points| Cloud::new(points).expect("points");
        assert!((chamfer(&cloud(a), &cloud(b)) - 6.848_430_386).abs() < 1e-6);
    }
}
