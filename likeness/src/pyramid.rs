//! Laplacian pyramids (Burt and Adelson, "The Laplacian pyramid as a compact image code", 1983): what an image has of coarse and of fine
//! structure.

/// Binomial weights along an axis.
const WEIGHTS: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

/// What lies beside the first and the last column; above the top ring and below the last one an image is always mirrored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Border {
    /// The other end: the image is a whole turn.
    Turn,
    /// The same columns backwards.
    Mirror,
}

/// An image of one channel, `[ring, column]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// Columns.
    pub columns: usize,
    /// Values, row-major.
    pub values: Vec<f32>,
}

impl Plane {
    /// Rows.
    pub fn rings(&self) -> usize {
        self.values.len() / self.columns
    }

    /// The value at a place that may be beyond the edges, by less than the image is wide.
    pub fn at(&self, ring: isize, column: isize, border: Border) -> f32 {
        let column = match border {
            Border::Turn => column.rem_euclid(self.columns as isize) as usize,
            Border::Mirror => mirrored(column, self.columns),
        };
        self.values[mirrored(ring, self.rings()) * self.columns + column]
    }

    fn from_fn(rings: usize, columns: usize, value: impl Fn(isize, isize) -> f32) -> Self {
        let values = (0..rings * columns).map(|i| value((i / columns) as isize, (i % columns) as isize)).collect();
        Self { columns, values }
    }

    /// Blurred along both axes by the weights times `gain`, an axis at a time.
    fn blurred(&self, border: Border, gain: f32) -> Self {
        let sum = |of: &dyn Fn(isize) -> f32| WEIGHTS.iter().zip(-2..).map(|(w, k)| w * of(k)).sum::<f32>();
        let across = Self::from_fn(self.rings(), self.columns, |r, c| sum(&|k| self.at(r, c + k, border)));
        Self::from_fn(self.rings(), self.columns, |r, c| gain * sum(&|k| across.at(r + k, c, border)))
    }

    /// At half the size.
    fn halved(&self, border: Border) -> Self {
        let blurred = self.blurred(border, 1.0);
        Self::from_fn(self.rings().div_ceil(2), self.columns.div_ceil(2), |r, c| blurred.at(2 * r, 2 * c, border))
    }

    /// At the size of another, which was halved to this one's.
    fn doubled(&self, like: &Self, border: Border) -> Self {
        let spread = Self::from_fn(like.rings(), like.columns, |r, c| {
            if r % 2 == 0 && c % 2 == 0 { self.values[r as usize / 2 * self.columns + c as usize / 2] } else { 0.0 }
        });
        spread.blurred(border, 4.0)
    }
}

/// What each of `levels` sizes adds to the next smaller one, the finest first; the last is what is left.
pub fn laplacian(image: Plane, levels: usize, border: Border) -> Vec<Plane> {
    let mut out = Vec::with_capacity(levels);
    let mut gaussian = image;
    for _ in 1..levels {
        let smaller = gaussian.halved(border);
        let rough = smaller.doubled(&gaussian, border);
        gaussian.values.iter_mut().zip(rough.values).for_each(|(fine, rough)| *fine -= rough);
        out.push(std::mem::replace(&mut gaussian, smaller));
    }
    out.push(gaussian);
    out
}

/// Index of a place of an axis that goes on backwards beyond its ends, the ends themselves not repeated.
fn mirrored(at: isize, length: usize) -> usize {
    if length == 1 {
        return 0;
    }
    let around = at.rem_euclid(2 * (length as isize - 1)) as usize;
    around.min(2 * (length - 1) - around)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Plane {
        Plane { columns: 12, values: (0..96).map(|i| (i * i % 31) as f32).collect() }
    }

    #[test]
    fn the_levels_add_up_to_the_image() {
        for border in [Border::Turn, Border::Mirror] {
            let levels = laplacian(ramp(), 3, border);
            assert_eq!(levels.iter().map(|l| (l.rings(), l.columns)).collect::<Vec<_>>(), [(8, 12), (4, 6), (2, 3)]);
            let mut image = levels[2].clone();
            for level in levels[..2].iter().rev() {
                image = image.doubled(level, border);
                image.values.iter_mut().zip(&level.values).for_each(|(rough, fine)| *rough += fine);
            }
            for (found, expected) in image.values.iter().zip(ramp().values) {
                assert!((found - expected).abs() < 1e-4);
            }
        }
    }

    // scipy: x = np.array([i*i % 31 for i in range(96)], float).reshape(8, 12); w = np.outer(b, b) with b = np.array([1, 4, 6, 4, 1])/16;
    // g = scipy.ndimage.convolve(x, w, mode='mirror')[::2, ::2]; u = np.zeros((8, 12)); u[::2, ::2] = g; l = x -
    // scipy.ndimage.convolve(u, 4*w, mode='mirror'); l[0, 0], l[3, 5], l[7, 11]; the same with
    // mode='wrap' along the columns
    #[test]
    fn the_finest_level_is_scipys() {
        let at = |border| {
            let fine = &laplacian(ramp(), 3, border)[0];
            [fine.values[0], fine.values[3 * 12 + 5], fine.values[95]]
        };
        let (mirror, turn) = ([-10.537_354, -4.672_852, -8.667_969], [-11.768_799, -4.672_852, -7.757_812]);
        for (found, expected) in [(at(Border::Mirror), mirror), (at(Border::Turn), turn)] {
            assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-4), "{found:?}");
        }
    }

    #[test]
    fn turning_the_image_turns_its_pyramid() {
        let turn = |x: &Plane, by: isize| Plane::from_fn(x.rings(), x.columns, |r, c| x.at(r, c + by, Border::Turn));
        let turned = laplacian(turn(&ramp(), 4), 3, Border::Turn);
        for (level, by) in
            laplacian(ramp(), 3, Border::Turn).iter().zip([4, 2, 1]).zip(&turned).map(|((l, by), t)| ((l, t), by))
        {
            let (level, turned) = level;
            for (a, b) in turn(level, by).values.iter().zip(&turned.values) {
                assert!((a - b).abs() < 1e-5);
            }
        }
    }
}
