//! How well vehicles are found.

use super::detector::Found;
use super::footprint::Footprint;
use super::vehicles::Vehicles;

/// Recalls that precision is taken at: KITTI's forty.
const RECALLS: usize = 40;

/// When what was found is the vehicle that is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Match {
    /// Centres at most so many metres apart, as nuScenes has it.
    Within(f32),
    /// They overlap by this share of what they cover together, or more, as KITTI has it.
    Overlap(f32),
}

impl Match {
    /// How near they are by this measure, if it is near enough; smaller is nearer.
    fn off(self, found: &Footprint, vehicle: &Footprint) -> Option<f32> {
        match self {
            Self::Within(most) => Some(found.distance_m(vehicle)).filter(|off| *off <= most),
            Self::Overlap(least) => {
                Some(found.overlap(vehicle)).filter(|share| *share >= least).map(|share| 1.0 - share)
            }
        }
    }
}

/// Average precision over all scans: the mean, over recalls of 1/40 to 1, of the highest precision at this recall or more; 0 where it is not
/// reached. NaN where there is no vehicle.
///
/// Those found with the highest scores come first, and each takes the nearest vehicle that none before it took. Who finds an unclear one is
/// neither right nor wrong.
pub(super) fn average_precision(scans: &[(Vec<Found>, &Vehicles)], matched: Match) -> f64 {
    let vehicles: usize = scans.iter().map(|(_, vehicles)| vehicles.clear.len()).sum();
    let mut found: Vec<(usize, Found)> =
        scans.iter().enumerate().flat_map(|(scan, (found, _))| found.iter().map(move |found| (scan, *found))).collect();
    found.sort_by(|a, b| b.1.score.total_cmp(&a.1.score));
    let mut taken: Vec<Vec<bool>> = scans.iter().map(|(_, vehicles)| vec![false; vehicles.clear.len()]).collect();
    let (mut right, mut wrong) = (0usize, 0usize);
    // Precision once so many vehicles have been found.
    let mut precision = vec![];
    for (scan, Found { footprint, .. }) in found {
        let vehicles = scans[scan].1;
        let open = vehicles.clear.iter().enumerate().filter(|(i, _)| !taken[scan][*i]);
        let near = open.filter_map(|(i, vehicle)| Some((i, matched.off(&footprint, vehicle)?)));
        if let Some((i, _)) = near.min_by(|a, b| a.1.total_cmp(&b.1)) {
            taken[scan][i] = true;
            right += 1;
            precision.push(right as f64 / (right + wrong) as f64);
        } else if !vehicles
            .unclear
            .iter()
            .any(|vehicle| matched.off(&footprint, vehicle).is_some() || vehicle.holds(footprint.center_m))
        {
            wrong += 1;
        }
    }
    for i in (1..precision.len()).rev() {
        precision[i - 1] = precision[i - 1].max(precision[i]);
    }
    let at = |recall: usize| precision.get((recall * vehicles).div_ceil(RECALLS) - 1).copied().unwrap_or(0.0);
    if vehicles == 0 { f64::NAN } else { (1..=RECALLS).map(at).sum::<f64>() / RECALLS as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn car(x: f32) -> Footprint {
        Footprint::new([x, 0.0], [4.0, 1.8], 0.0)
    }

    fn found(x: f32, score: f32) -> Found {
        Found { footprint: car(x), score }
    }

    const NEAR: Match = Match::Within(1.0);

    #[test]
    fn average_precision_is_that_of_its_definition() {
        let vehicles = Vehicles { clear: [0.0, 10.0, 20.0, 30.0].map(car).to_vec(), unclear: vec![] };
        let score = |found: Vec<Found>| average_precision(&[(found, &vehicles)], NEAR);
        let all = || [0.0, 10.0, 20.0, 30.0].map(|x| found(x, 0.5 + x / 100.0)).to_vec();
        assert_eq!(score(all()), 1.0);
        assert_eq!(score(vec![]), 0.0);
        // Right, wrong, right: precision 1 up to a recall of ¼, ⅔ up to ½, then none.
        let some = vec![found(0.0, 0.9), found(5.0, 0.8), found(10.4, 0.7)];
        assert!((score(some) - (0.25 + 0.25 * 2.0 / 3.0)).abs() < 1e-9);
        // A second one at a vehicle that was found is wrong; after all others it costs nothing.
        assert_eq!(score([all(), vec![found(0.2, 0.1)]].concat()), 1.0);
        let twice = [vec![found(0.2, 0.99), found(-0.2, 0.98)], all()].concat();
        assert!((score(twice) - (0.25 + 0.75 * 0.8)).abs() < 1e-9);
        assert!(average_precision(&[(vec![], &Vehicles::default())], NEAR).is_nan());
    }

    #[test]
    fn who_finds_what_is_unclear_is_neither_right_nor_wrong() {
        let vehicles = Vehicles { clear: vec![car(0.0)], unclear: vec![car(10.0)] };
        let score = |first: f32| average_precision(&[(vec![found(first, 0.9), found(0.0, 0.8)], &vehicles)], NEAR);
        assert_eq!((score(11.5), score(20.0)), (1.0, 0.5));
    }

    #[test]
    fn a_scans_vehicles_are_found_in_that_scan() {
        let (here, there) = (Vehicles { clear: vec![car(0.0)], unclear: vec![] }, Vehicles::default());
        assert_eq!(average_precision(&[(vec![], &here), (vec![found(0.0, 0.9)], &there)], NEAR), 0.0);
        let overlap = |x: f32, least| average_precision(&[(vec![found(x, 0.9)], &here)], Match::Overlap(least));
        // 3 m of 4 in common: 3/5 of what both cover.
        assert_eq!((overlap(1.0, 0.59), overlap(1.0, 0.61)), (1.0, 0.0));
    }
}
