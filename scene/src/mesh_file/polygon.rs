//! Polygons with holes, in space, into triangles.

use earcut::Earcut;
use earcut::utils3d::project3d_to_2d;

/// Cuts polygons into triangles, keeping its memory from one to the next.
pub(super) struct Cutter {
    earcut: Earcut<f64>,
    flat: Vec<[f64; 2]>,
    triangles: Vec<u32>,
}

impl Cutter {
    pub(super) fn new() -> Self {
        Self { earcut: Earcut::new(), flat: Vec::new(), triangles: Vec::new() }
    }

    /// Triangles of a polygon whose first ring is its outline and whose others are holes, as indices into all rings' points one
    /// after the other. A polygon without area has none.
    pub(super) fn cut(&mut self, rings: &[Vec<[f64; 3]>]) -> Vec<[u32; 3]> {
        let points: Vec<[f64; 3]> = rings.iter().flatten().copied().collect();
        let outline = rings.first().map_or(0, Vec::len);
        if points.len() == 3 {
            return vec![[0, 1, 2]];
        }
        if outline < 3 || !project3d_to_2d(&points, outline, &mut self.flat) {
            return Vec::new();
        }
        let mut start = 0u32;
        let mut holes = Vec::new();
        for ring in rings {
            if start > 0 {
                holes.push(start);
            }
            start += ring.len() as u32;
        }
        self.earcut.earcut(self.flat.iter().copied(), &holes, &mut self.triangles);
        self.triangles.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_with_a_window_keeps_its_hole() {
        // In the plane y = 2 x, so that no axis can be left out.
        let place = |x: f64, z: f64| [x, 2.0 * x, z];
        let square = |a: f64, b: f64| vec![place(a, a), place(b, a), place(b, b), place(a, b)];
        let rings = [square(0.0, 4.0), square(1.0, 2.0)];
        let points: Vec<_> = rings.iter().flatten().copied().collect();
        let area: f64 = Cutter::new()
            .cut(&rings)
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| glam::DVec3::from_array(points[i as usize]));
                0.5 * (b - a).cross(c - a).length()
            })
            .sum();
        assert!((area - (16.0 - 1.0) * 5f64.sqrt()).abs() < 1e-9, "area {area}");
    }

    #[test]
    fn a_polygon_without_area_has_no_triangles() {
        let line = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]];
        assert!(Cutter::new().cut(&[line]).is_empty());
        assert!(Cutter::new().cut(&[]).is_empty());
    }
}
