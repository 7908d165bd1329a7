//! Density-aware Chamfer distance: how far clouds lie apart, and how unevenly.

use crate::chamfer::mean;
use crate::metric::Metric;
use crate::nearest::{Cloud, Nearest};

/// Of a scan and its simulation.
pub const DENSITY_AWARE: Metric = Metric {
    name: "density-aware Chamfer distance",
    unit: "",
    definition: "Wu et al. 2021, eq. 5 with α = 4 m⁻² (distance squared): 0 where clouds are one, at most 1; all returns of the output against \
                 all of the simulation, so lost returns count; mean over scans",
};

/// Distances are squared and divided by ¼ m² in the exponent: half a metre is far, a centimetre is nothing.
const ALPHA_PER_M2: f64 = 4.0;

/// ½·(mean over a of 1 − exp(−α·|a − b̂|²)/n(b̂) + the same the other way round), b̂ being the nearest of b and n(b̂) the number of points
/// of a that have it as theirs: Wu et al., "Density-aware Chamfer distance as a comprehensive metric for point cloud completion" (2021),
/// eq. 5, whose |a − b̂| is squared as in its code.
pub fn density_aware(a: &Cloud, b: &Cloud) -> f64 {
    0.5 * (one_way(a, b) + one_way(b, a))
}

fn one_way(from: &Cloud, to: &Cloud) -> f64 {
    let nearest: Vec<Nearest> = from.points().iter().map(|p| to.nearest(p)).collect();
    let mut shared = vec![0u32; to.points().len()];
    for n in &nearest {
        shared[n.index] += 1;
    }
    mean(nearest.iter().map(|n| 1.0 - (-ALPHA_PER_M2 * f64::from(n.squared)).exp() / f64::from(shared[n.index])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::Point;

    fn cloud(x: &[f32]) -> Cloud {
        Cloud::new(x.iter().map(|x| [*x, 0.0, 0.0]).collect::<Vec<Point>>()).expect("points")
    }

    #[test]
    fn points_that_share_a_neighbour_share_its_credit() {
        let whole = cloud(&[0.0, 10.0]);
        assert!(density_aware(&whole, &whole).abs() < 1e-12);
        // Two points at 0 have one partner (1 − ½ each), that at 10 has its own; the way back all is well: ½·((½ + ½ + 0)/3 + 0).
        assert!((density_aware(&cloud(&[0.0, 0.001, 10.0]), &whole) - 1.0 / 6.0).abs() < 1e-5);
        // Half a metre off: 1 − e⁻¹ for one of two points, both ways.
        let moved = density_aware(&cloud(&[0.5, 10.0]), &whole);
        assert!((moved - 0.5 * (1.0 - (-1f64).exp())).abs() < 1e-6, "{moved}");
        assert!((density_aware(&cloud(&[500.0]), &cloud(&[0.0])) - 1.0).abs() < 1e-12);
    }
}
