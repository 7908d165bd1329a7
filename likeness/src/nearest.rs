//! Nearest neighbours in a cloud, by a k-d tree (Bentley 1975): points sorted so that the middle of every stretch splits it.

use crate::points::{Point, squared};

/// A cloud that can be asked.
#[derive(Clone, Debug)]
pub struct Cloud {
    points: Vec<Point>,
    /// Indices of the points in the order of a balanced tree.
    tree: Vec<u32>,
}

/// The nearest point of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Its index.
    pub index: usize,
    /// Squared distance to it.
    pub squared: f32,
}

impl Cloud {
    /// A cloud of finite points; `None` if there is no point.
    pub fn new(points: Vec<Point>) -> Option<Self> {
        let mut tree: Vec<u32> = (0..points.len() as u32).collect();
        sort(&points, &mut tree, 0);
        (!points.is_empty()).then_some(Self { points, tree })
    }

    /// Its points.
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// The point nearest to this one.
    pub fn nearest(&self, to: &Point) -> Nearest {
        let mut best = Nearest { index: 0, squared: f32::INFINITY };
        self.search(&self.tree, 0, to, &mut best);
        best
    }

    fn search(&self, tree: &[u32], axis: usize, to: &Point, best: &mut Nearest) {
        let middle = tree.len() / 2;
        let Some(index) = tree.get(middle).map(|i| *i as usize) else { return };
        let away = squared(&self.points[index], to);
        if away < best.squared {
            *best = Nearest { index, squared: away };
        }
        let beyond = to[axis] - self.points[index][axis];
        let (below, above) = (&tree[..middle], &tree[middle + 1..]);
        let (near, far) = if beyond < 0.0 { (below, above) } else { (above, below) };
        let next = (axis + 1) % 3;
        self.search(near, next, to, best);
        if beyond * beyond < best.squared {
            self.search(far, next, to, best);
        }
    }
}

fn sort(points: &[Point], tree: &mut [u32], axis: usize) {
    if tree.len() > 1 {
        let middle = tree.len() / 2;
        let by_axis = |a: &u32, b: &u32| points[*a as usize][axis].total_cmp(&points[*b as usize][axis]);
        let (below, _, above) = tree.select_nth_unstable_by(middle, by_axis);
        sort(points, below, (axis + 1) % 3);
        sort(points, above, (axis + 1) % 3);
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
        // A floor: many points share a coordinate.
        let mut point = |z: f32| [rng.random_range(-10.0f32..10.0), rng.random_range(-10.0f32..10.0), z];
        let points: Vec<Point> = (0..3000).map(|i| point(if i % 2 == 0 { -1.7 } else { 0.5 })).collect();
        let cloud = Cloud::new(points.clone()).expect("points");
        for _ in 0..200 {
            let to = point(0.1);
            let least = points.iter().map(|p| squared(p, &to)).fold(f32::INFINITY, f32::min);
            let found = cloud.nearest(&to);
            assert_eq!(found.squared, least);
            assert_eq!(squared(&points[found.index], &to), least);
        }
        assert!(Cloud::new(vec![]).is_none());
    }
}
