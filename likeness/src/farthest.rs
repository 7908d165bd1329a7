//! Few points that stand for many.

use crate::points::{Point, squared};

/// Farthest point sampling (Eldar et al., "The farthest point strategy for progressive image sampling", 1997): the first point, then again
/// and again the one that is farthest from all chosen before, the first of equals. All of them where there are no more than `count`.
pub fn farthest_points(points: &[Point], count: usize) -> Vec<Point> {
    if points.len() <= count {
        return points.to_vec();
    }
    let mut chosen = Vec::with_capacity(count);
    let mut away = vec![f32::INFINITY; points.len()];
    let mut next = 0;
    while chosen.len() < count {
        let last = points[next];
        chosen.push(last);
        let mut farthest = -1.0;
        for (i, (point, away)) in points.iter().zip(&mut away).enumerate() {
            *away = away.min(squared(point, &last));
            if *away > farthest {
                (farthest, next) = (*away, i);
            }
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_on_a_line_are_halved_and_halved_again() {
        let line: Vec<Point> = (0..9).map(|x| [x as f32, 0.0, 0.0]).collect();
        let chosen: Vec<f32> = farthest_points(&line, 5).iter().map(|p| p[0]).collect();
        assert_eq!(chosen, [0.0, 8.0, 4.0, 2.0, 6.0]);
        assert_eq!(farthest_points(&line, 20), line);
    }
}
