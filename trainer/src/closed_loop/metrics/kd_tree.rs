//! Nearest neighbours by a k-d tree (Bentley 1975): points sorted so that the middle of every stretch splits it.

/// Points in the order of a balanced tree.
#[derive(Clone, Debug)]
pub(super) struct KdTree(Vec<[f32; 3]>);

impl KdTree {
    pub(super) fn new(mut points: Vec<[f32; 3]>) -> Self {
        sort(&mut points, 0);
        Self(points)
    }

    /// Squared distance to the nearest point; infinite if there is none, NaN if there is not even a tree.
    pub(super) fn nearest_squared(&self, to: &[f32; 3]) -> f32 {
        if self.0.is_empty() {
            return f32::NAN;
        }
        let mut best = f32::INFINITY;
        search(&self.0, 0, to, &mut best);
        best
    }
}

fn sort(points: &mut [[f32; 3]], axis: usize) {
    if points.len() > 1 {
        let middle = points.len() / 2;
        let (below, _, above) = points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
        sort(below, (axis + 1) % 3);
        sort(above, (axis + 1) % 3);
    }
}

fn search(points: &[[f32; 3]], axis: usize, to: &[f32; 3], best: &mut f32) {
    let middle = points.len() / 2;
    let Some(point) = points.get(middle) else { return };
    let squared = (0..3).map(|i| (point[i] - to[i]).powi(2)).sum::<f32>();
    *best = best.min(squared);
    let beyond = to[axis] - point[axis];
    let (below, above) = (&points[..middle], &points[middle + 1..]);
    let (near, far) = if beyond < 0.0 { (below, above) } else { (above, below) };
    search(near, (axis + 1) % 3, to, best);
    if beyond * beyond < *best {
        search(far, (axis + 1) % 3, to, best);
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn the_tree_finds_what_looking_at_every_point_finds() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut point = || [0; 3].map(|_| rng.random_range(-10.0f32..10.0));
        let points: Vec<[f32; 3]> = (0..500).map(|_| point()).collect();
        let tree = KdTree::new(points.clone());
        for _ in 0..200 {
            let to = point();
            let all = points.iter().map(|p| (0..3).map(|i| (p[i] - to[i]).powi(2)).sum::<f32>());
            assert_eq!(tree.nearest_squared(&to), all.fold(f32::INFINITY, f32::min));
        }
    }
}
