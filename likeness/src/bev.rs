//! Where returns are on the ground, seen from above: counts in 100 × 100 cells.

use crate::divergence::root_nats;
use crate::kernel::discrepancy;
use crate::metric::Metric;
use crate::points::Point;

/// Of the returns of all scans together.
pub const JSD_BEV_ROOT_NATS: Metric = Metric {
    name: "JSD of 100×100 BEV",
    unit: "√nat",
    definition: "scipy's jensenshannon (square root of the Jensen-Shannon divergence in nats) of the counts of the returns of all scans from 3 to \
                 70 m in 100 × 100 cells over ±80 m seen from above, as LiDARGen and R2DM have it",
};

/// Of the returns scan by scan.
pub const MMD_KERNEL: Metric = Metric {
    name: "MMD, kernel mean discrepancy",
    unit: "",
    definition: "square of the maximum mean discrepancy (Gretton et al. 2012, biased) of scans' 100 × 100 BEV counts, each scaled to a sum of 1, \
                 with the kernel exp(−|x − y|²/(2·0.5²)), as LiDARGen and R2DM have it",
};

/// Cells along an axis, and half the width of all of them in metres.
const SIDE: usize = 100;
const REACH_M: f32 = 80.0;

/// Distances from the sensor between which returns count, in metres.
const RANGE_M: [f32; 2] = [3.0, 70.0];

/// Standard deviation of the kernel.
const SIGMA: f64 = 0.5;

/// Counts of a scan's returns in 100 × 100 cells, `[x, y]`.
pub fn count(points: &[Point]) -> Vec<u32> {
    let mut counts = vec![0; SIDE * SIDE];
    for point in points {
        let range_m = crate::points::squared(point, &[0.0; 3]).sqrt();
        if (RANGE_M[0]..RANGE_M[1]).contains(&range_m) {
            let cell = |x: f32| ((x + REACH_M) / (2.0 * REACH_M) * SIDE as f32) as usize;
            counts[cell(point[0]) * SIDE + cell(point[1])] += 1;
        }
    }
    counts
}

/// [`JSD_BEV_ROOT_NATS`] of two sets of scans' counts.
pub fn jsd_root_nats<'a>(a: impl IntoIterator<Item = &'a [u32]>, b: impl IntoIterator<Item = &'a [u32]>) -> f64 {
    let sum = |counts: &mut dyn Iterator<Item = &'a [u32]>| {
        let mut sum = vec![0.0; SIDE * SIDE];
        counts.for_each(|one| sum.iter_mut().zip(one).for_each(|(sum, count)| *sum += f64::from(*count)));
        sum
    };
    root_nats(&sum(&mut a.into_iter()), &sum(&mut b.into_iter()))
}

/// The kernel of [`MMD_KERNEL`] between two scans' counts.
pub fn kernel(a: &[u32], b: &[u32]) -> f64 {
    let (sum_a, sum_b) = (f64::from(a.iter().sum::<u32>()), f64::from(b.iter().sum::<u32>()));
    let away = a.iter().zip(b).map(|(a, b)| (f64::from(*a) / sum_a - f64::from(*b) / sum_b).powi(2));
    (-away.sum::<f64>() / (2.0 * SIGMA * SIGMA)).exp()
}

/// [`MMD_KERNEL`] of two sets of scans' counts.
pub fn mmd(a: &[Vec<u32>], b: &[Vec<u32>]) -> f64 {
    let table =
        |a: &[Vec<u32>], b: &[Vec<u32>]| crate::kernel::Table::new(a.len(), b.len(), |i, j| kernel(&a[i], &b[j]));
    let all = |n: usize| (0..n).collect::<Vec<usize>>();
    discrepancy([&table(a, a), &table(b, b), &table(a, b)], &all(a.len()), &all(b.len()))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    // Points on a rising spiral, 1 to 50 m away: i = np.arange(n); r = 1 + 49*((i*.618 + shift) % 1);
    // np.stack([r*np.cos(i), r*np.sin(i), 4*((i*.414) % 1) - 2], -1)
    pub(crate) fn spiral(count: usize, shift: f64) -> Vec<Point> {
        let point = |i: usize| {
            let i = i as f64;
            let r = 1.0 + 49.0 * (i * 0.618 + shift).fract();
            [r * i.cos(), r * i.sin(), 4.0 * (i * 0.414).fract() - 2.0].map(|x| x as f32)
        };
        (0..count).map(point).collect()
    }

    // numpy: def count(p): r = np.linalg.norm(p, axis=1); p = p[(r >= 3) & (r < 70)]; return np.histogram2d(p[:,0], p[:,1], 100,
    // [[-80, 80]]*2)[0].ravel(); jensenshannon(count(spiral(400, 0)), count(spiral(300, .3)))
    #[test]
    fn the_divergence_of_counts_is_scipys() {
        let (a, b) = (count(&spiral(400, 0.0)), count(&spiral(300, 0.3)));
        let found = jsd_root_nats([a.as_slice()], [b.as_slice()]);
        assert!((found - 0.815_933_164_293).abs() < 1e-9, "{found}");
    }

    // numpy: A = np.array([count(spiral(200, s)) for s in (0, .1, .2)], float); B the same for (.5, .7); A /= A.sum(1, keepdims=True)...;
    // k = lambda x, y: np.exp(-cdist(x, y, 'sqeuclidean')/.5).mean(); k(A, A) + k(B, B) - 2*k(A, B)
    #[test]
    fn the_discrepancy_is_that_of_three_means_of_the_kernel() {
        let set = |shifts: &[f64]| shifts.iter().map(|s| count(&spiral(200, *s))).collect::<Vec<Vec<u32>>>();
        let found = mmd(&set(&[0.0, 0.1, 0.2]), &set(&[0.5, 0.7]));
        assert!((found - 0.021_706_900_868_3).abs() < 1e-12, "{found}");
    }
}
