//! Chamfer distance: how far clouds lie apart, point to nearest point.

use super::kd_tree::KdTree;

/// Points of either cloud whose nearest is looked for: enough for a mean.
const MOST_ASKED: usize = 16_384;

/// The points of a frame.
#[derive(Clone, Debug)]
pub(super) struct Cloud {
    points: Vec<[f32; 3]>,
    tree: KdTree,
}

impl Cloud {
    /// Ranges along rays, m; 0 = none.
    pub(super) fn new(range_m: &[f32], [x, y, z]: &[Vec<f32>; 3]) -> Self {
        let points: Vec<[f32; 3]> = range_m
            .iter()
            .enumerate()
            .filter(|(_, r)| **r > 0.0)
            .map(|(i, r)| [x[i] * r, y[i] * r, z[i] * r])
            .collect();
        Self { tree: KdTree::new(points.clone()), points }
    }
}

/// Mean distance from a point of either cloud to the nearest of the other, both ways averaged, m. NaN if either is empty.
pub(super) fn chamfer(a: &Cloud, b: &Cloud) -> f64 {
    let one_way = |from: &Cloud, to: &Cloud| {
        let every = from.points.len().div_ceil(MOST_ASKED).max(1);
        let asked = from.points.iter().step_by(every);
        let n = asked.len() as f64;
        asked.map(|p| f64::from(to.tree.nearest_squared(p)).sqrt()).sum::<f64>() / n
    };
    0.5 * (one_way(a, b) + one_way(b, a))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_that_is_a_metre_short_is_a_metre_off() {
        let directions = [vec![1.0, -1.0, 0.0], vec![0.0, 0.0, 1.0], vec![0.0; 3]];
        let a = Cloud::new(&[10.0, 20.0, 0.0], &directions);
        let b = Cloud::new(&[9.0, 20.0, 0.0], &directions);
        assert!((chamfer(&a, &b) - 0.5).abs() < 1e-6);
        assert!(chamfer(&a, &a) < 1e-9);
        assert!(chamfer(&a, &Cloud::new(&[0.0; 3], &directions)).is_nan());
    }
}
