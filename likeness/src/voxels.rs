//! Where returns are in space: counts in 28³ voxels.

use crate::divergence::bits;
use crate::metric::Metric;
use crate::points::Point;

/// Of the returns.
pub const JSD_VOXEL_BITS: Metric = Metric {
    name: "JSD of 28³ voxels",
    unit: "bits",
    definition: "Jensen-Shannon divergence, base 2, of the counts of all returns of all scans in a lattice of 28³ voxels around the sensor, 120 m \
                 in each direction (8.9 m a voxel), those within the sphere, as DUSty and CLS2R have it",
};

/// Voxels along an axis.
const SIDE: usize = 28;

/// Counts of points in a lattice of 28³ voxels, whose middles lie from −`reach` to `reach` along each axis. A point counts in the voxel
/// whose middle is nearest among those within the sphere of that radius: Achlioptas et al., "Learning representations and generative models
/// for 3D point clouds" (2018), whose code the papers use.
pub fn count(points: &[Point], reach: f32) -> Vec<u32> {
    let inside: Vec<[f32; 3]> = (0..SIDE.pow(3)).map(middle).filter(within).collect();
    let mut counts = vec![0; SIDE.pow(3)];
    for point in points {
        // In voxels from the lattice's corner.
        let at = point.map(|x| (x / reach * 0.5 + 0.5) * (SIDE - 1) as f32);
        let mut cell = at.map(|x| x.round().clamp(0.0, (SIDE - 1) as f32));
        if !within(&cell) {
            let away = |m: &[f32; 3]| crate::points::squared(m, &at);
            cell = inside.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(cell);
        }
        counts[(cell[0] as usize * SIDE + cell[1] as usize) * SIDE + cell[2] as usize] += 1;
    }
    counts
}

/// Coordinates of a voxel's middle, in voxels.
fn middle(i: usize) -> [f32; 3] {
    [i / (SIDE * SIDE), i / SIDE % SIDE, i % SIDE].map(|x| x as f32)
}

/// Whether a voxel's middle is within the sphere.
fn within(cell: &[f32; 3]) -> bool {
    let centre = (SIDE - 1) as f32 / 2.0;
    crate::points::squared(cell, &[centre; 3]) <= centre * centre
}

/// [`JSD_VOXEL_BITS`] of two sets of scans' counts.
pub fn jsd_bits<'a>(a: impl IntoIterator<Item = &'a [u32]>, b: impl IntoIterator<Item = &'a [u32]>) -> f64 {
    bits(&sum(a), &sum(b))
}

fn sum<'a>(counts: impl IntoIterator<Item = &'a [u32]>) -> Vec<f64> {
    let mut sum = vec![0.0; SIDE.pow(3)];
    for one in counts {
        for (sum, count) in sum.iter_mut().zip(one) {
            *sum += f64::from(*count);
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bev::tests::spiral;

    // numpy: g = np.stack(np.meshgrid(*[np.linspace(-.5, .5, 28)]*3, indexing='ij'), -1).reshape(-1, 3); g = g[(g**2).sum(1) <= .25];
    // count = lambda p: np.bincount(cdist(p/60/2, g).argmin(1), minlength=len(g)); jensenshannon(count(spiral(400, 0)),
    // count(spiral(300, .3)), 2)**2
    #[test]
    fn the_divergence_of_counts_is_that_of_a_search_for_the_nearest_voxel() {
        let (a, b) = (count(&spiral(400, 0.0), 60.0), count(&spiral(300, 0.3), 60.0));
        assert_eq!(a.iter().sum::<u32>(), 400);
        let found = jsd_bits([a.as_slice()], [b.as_slice()]);
        assert!((found - 0.725_324_178_799).abs() < 1e-9, "{found}");
    }

    #[test]
    fn a_point_beyond_the_sphere_counts_in_the_nearest_voxel_within() {
        let corner = count(&[[90.0, 90.0, 90.0]], 100.0);
        let at = corner.iter().position(|c| *c == 1).map(middle);
        assert!(at.is_some_and(|cell| within(&cell) && cell[0] > 20.0), "{at:?}");
    }
}
