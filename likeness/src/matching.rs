//! Minimum matching distance: whether every real scan has something like it among those that are judged.

use crate::kernel::Table;
use crate::metric::Metric;

/// Points that stand for a scan.
pub const POINTS: usize = 512;

/// Of the returns scan by scan.
pub const MMD_MATCHING: Metric = Metric {
    name: "MMD, minimum matching distance",
    unit: "m",
    definition: "mean over real scans of the least Chamfer distance (mean distance, both ways averaged) to any scan that is judged, each scan being \
                 512 of its returns by farthest point sampling",
};

/// Mean over columns of the least of the rows, for these rows and columns of a table of distances: Achlioptas et al., "Learning
/// representations and generative models for 3D point clouds" (2018).
pub fn minimum_matching(distance: &Table, rows: &[usize], columns: &[usize]) -> f64 {
    let least = |j: usize| rows.iter().map(|i| distance.at(*i, j)).fold(f64::INFINITY, f64::min);
    columns.iter().map(|j| least(*j)).sum::<f64>() / columns.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_real_scan_counts_once_whoever_is_nearest_to_it() {
        // Two judged scans, three real ones: least 1, 2, 0.
        let distance = [[1.0, 5.0, 0.0], [4.0, 2.0, 9.0]];
        let table = Table::new(2, 3, |i, j| distance[i][j]);
        assert!((minimum_matching(&table, &[0, 1], &[0, 1, 2]) - 1.0).abs() < 1e-12);
        // Without the first, 4, 2, 9.
        assert!((minimum_matching(&table, &[1], &[0, 1, 2]) - 5.0).abs() < 1e-12);
    }
}
