//! How lost rays hang together along their ring, measured on real scans: what a keep probability for each ray leaves open.

use std::fmt::Write as _;

use lidar::RangeImage;
use lidar::ray_drop::{Burst, Bursts, BurstsError, RayDrop};
use nalgebra::{SMatrix, SVector};

use crate::data::holes::{Pixel, REACH_COLUMNS};
use crate::data::sample::Sample;
use crate::generator::Answer;

/// Distances up to this many columns are looked at: holes of real scans are filled no farther.
const FARTHEST_COLUMNS: usize = 2 * REACH_COLUMNS;

/// Bursts are at most this share of that distance long. What hangs together farther is not lost in one piece: there the model is wrong about
/// a whole region.
const LONGEST: f64 = 1.0 / 3.0;

/// A kind of bursts that fewer rays than this share are in is left out.
const LEAST_SHARE: f64 = 0.02;

/// Shares add up to this at most: once rounded to thousandths they must not be more than all rays.
const LARGEST_SUM: f64 = 0.999;

/// Steps from one length that is tried to the next.
const LENGTH_STEP: f64 = 1.15;

/// Pairs of rays of one ring, so far apart, that the sensor could have reported.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Pairs {
    /// Distance in degrees of azimuth.
    azimuth_deg: f64,
    /// How many rays of them are lost: half of those that are one or the other of a pair.
    lost: f64,
    /// Pairs that are both lost.
    both: f64,
    /// Pairs that would both be lost if each ray were for itself, by the model's probabilities.
    alone: f64,
    /// Pairs that would both be lost if their rays shared their number.
    sharing: f64,
}

/// Lost rays of real scans beside what a model says of each.
#[derive(Clone, Debug)]
pub struct Lost {
    /// By distance, from next to each other on.
    pairs: Vec<Pairs>,
    scans: Vec<Scan>,
    column_deg: f64,
}

/// What is known of a scan's rays, each `[ring, column]`.
#[derive(Clone, Debug)]
struct Scan {
    /// The scan made to look simulated: where it has no return nothing is said.
    simulated: RangeImage,
    /// Probability that the ray is reported.
    keep: Vec<f32>,
    /// Whether it was.
    kept: Vec<bool>,
}

/// Lengths of runs that are told apart, each up to the next.
const RUNS: [(usize, &str); 5] = [(1, "1"), (2, "2"), (3, "3 and 4"), (5, "5 to 8"), (9, "9 and more")];

impl Pairs {
    /// ρ, the share of the pairs that share their number: as many are lost together as were.
    fn together(&self) -> f64 {
        (self.both - self.alone) / (self.sharing - self.alone)
    }

    /// Share of the lost rays whose partner is lost as well, if pairs share their number with this probability.
    fn partner_lost(&self, together: f64) -> f64 {
        (self.alone + together * (self.sharing - self.alone)) / self.lost
    }
}

impl Lost {
    /// Counts pairs in real scans that were made to look simulated, with a model's answers to them; columns lie `column_deg` apart.
    ///
    /// The model's odds are all multiplied by one number first, so that it expects as many lost rays as there are: otherwise what it is wrong
    /// about everywhere would look like rays that are lost together.
    pub fn count(answered: &[(Sample, Answer)], column_deg: f64) -> Self {
        let odds: Vec<Vec<Option<f64>>> = answered.iter().map(|(sample, answer)| lost_odds(sample, answer)).collect();
        let lost = answered.iter().flat_map(|(sample, _)| &sample.pixel).filter(|p| **p == Pixel::Dropped).count();
        let expected = |shift: f64| odds.iter().flatten().flatten().map(|odds| logistic(odds + shift)).sum();
        let shift = balance(lost as f64, expected);
        let scan = |((sample, _), odds): (&(Sample, Answer), &Vec<Option<f64>>)| Scan {
            simulated: sample.simulated.clone(),
            keep: odds.iter().map(|odds| odds.map_or(1.0, |odds| 1.0 - logistic(odds + shift) as f32)).collect(),
            kept: sample.pixel.iter().map(|pixel| *pixel != Pixel::Dropped).collect(),
        };
        let scans: Vec<Scan> = answered.iter().zip(&odds).map(scan).collect();
        let mut pairs: Vec<Pairs> =
            lags().map(|lag| Pairs { azimuth_deg: lag as f64 * column_deg, ..Pairs::default() }).collect();
        for scan in &scans {
            for row in scan.rows(&scan.kept) {
                for (lag, pairs) in lags().zip(&mut pairs).filter(|(lag, _)| *lag < row.len()) {
                    for (one, other) in row.iter().zip(&row[lag..]) {
                        if let (Some(one), Some(other)) = (one, other) {
                            pairs.add(*one, *other);
                        }
                    }
                }
            }
        }
        pairs.retain(|pairs| pairs.lost > 0.0);
        Self { pairs, scans, column_deg }
    }

    /// The bursts that come nearest to what was counted, of at most two lengths, by least squares in ρ. None where rays are lost each for
    /// itself.
    pub fn fit(&self) -> Result<Bursts, BurstsError> {
        let Some(farthest) = self.pairs.last() else {
            return Ok(Bursts::default());
        };
        let (from, to) = (self.column_deg / 2.0, LONGEST * farthest.azimuth_deg);
        let lengths: Vec<f64> =
            std::iter::successors(Some(from), |l| Some(l * LENGTH_STEP)).take_while(|l| *l <= to).collect();
        let mut best = (self.error(&[]), vec![]);
        for (i, &short) in lengths.iter().enumerate() {
            let two = lengths[i + 1..].iter().map(|&long| self.tried([short, long]));
            for tried in two.chain([self.tried([short])]).flatten() {
                if tried.0 < best.0 {
                    best = tried;
                }
            }
        }
        let rounded = |x: f64| (1e3 * x).round() / 1e3;
        let burst = |(share, azimuth_deg)| Burst { share: rounded(share), azimuth_deg: rounded(azimuth_deg) };
        Bursts::new(best.1.into_iter().map(burst).collect())
    }

    /// Bursts of these lengths, and their squared error; `None` where their shares are none.
    fn tried<const N: usize>(&self, lengths: [f64; N]) -> Option<(f64, Vec<(f64, f64)>)> {
        let (mut normal, mut right) = (SMatrix::<f64, N, N>::zeros(), SVector::<f64, N>::zeros());
        for pairs in &self.pairs {
            let decay = SVector::from(lengths.map(|length| (-pairs.azimuth_deg / length).exp()));
            normal += decay * decay.transpose();
            right += decay * pairs.together();
        }
        let shares = normal.cholesky()?.solve(&right);
        let possible = shares.iter().all(|share| *share >= LEAST_SHARE) && shares.sum() <= LARGEST_SUM;
        let bursts: Vec<(f64, f64)> = shares.iter().copied().zip(lengths).collect();
        possible.then(|| (self.error(&bursts), bursts))
    }

    fn error(&self, bursts: &[(f64, f64)]) -> f64 {
        let together = |azimuth_deg: f64| bursts.iter().map(|(s, l)| s * (-azimuth_deg / l).exp()).sum::<f64>();
        self.pairs.iter().map(|pairs| (pairs.together() - together(pairs.azimuth_deg)).powi(2)).sum()
    }

    /// The shares of the lost rays that are in runs of each of [`RUNS`]: those of the real scans, or of scans drawn in bursts.
    fn runs(&self, drawn: Option<&Bursts>) -> [f64; RUNS.len()] {
        let mut rays = [0; RUNS.len()];
        let mut ray_drop = RayDrop::new(drawn.cloned().unwrap_or_default(), self.column_deg);
        for (seed, scan) in (0..).zip(&self.scans) {
            let mut kept = scan.kept.clone();
            if drawn.is_some() {
                ray_drop.sample(seed, &scan.simulated, &scan.keep, &mut kept);
            }
            for row in scan.rows(&kept) {
                let lost = |ray: &Option<(f64, bool)>| ray.is_some_and(|(_, lost)| lost);
                for run in row.chunk_by(|a, b| lost(a) == lost(b)).filter(|run| lost(&run[0])) {
                    rays[RUNS.partition_point(|(from, _)| *from <= run.len()) - 1] += run.len();
                }
            }
        }
        let all = rays.iter().sum::<usize>().max(1) as f64;
        rays.map(|rays| rays as f64 / all)
    }

    /// Of the lost rays, how many are in runs of which length, in the real scans and in scans drawn by the model's probabilities, each ray for
    /// itself and in these bursts; then how many have a lost ray so far beside them, as counted and as expected.
    pub fn to_table(&self, bursts: &Bursts) -> String {
        // Writing into a string cannot fail.
        let mut out =
            String::from("| lost rays in runs of | real | each for itself | in bursts |\n|---|---|---|---|\n");
        let drawn = [None, Some(&Bursts::default()), Some(bursts)].map(|drawn| self.runs(drawn));
        for (i, (_, length)) in RUNS.iter().enumerate() {
            let [real, alone, fitted] = drawn.map(|runs| 100.0 * runs[i]);
            let _ = writeln!(out, "| {length} | {real:.1} % | {alone:.1} % | {fitted:.1} % |");
        }
        out += "\n| lost rays with a lost one so far beside them | real | each for itself | in bursts |\n|---|---|---|---|\n";
        for pairs in &self.pairs {
            let share = |together| 100.0 * pairs.partner_lost(together);
            let (real, alone) = (share(pairs.together()), share(0.0));
            let fitted = share(bursts.together(pairs.azimuth_deg));
            let _ = writeln!(out, "| {:.1}° | {real:.1} % | {alone:.1} % | {fitted:.1} % |", pairs.azimuth_deg);
        }
        out
    }
}

impl Scan {
    /// Each ray's probability of being lost and whether it is one of those that are, ring by ring; nothing where there is no return to lose.
    fn rows(&self, kept: &[bool]) -> Vec<Vec<Option<(f64, bool)>>> {
        let rays = self.simulated.range_m().iter().zip(&self.keep).zip(kept);
        let rays: Vec<_> =
            rays.map(|((range_m, keep), kept)| (*range_m > 0.0).then(|| (1.0 - f64::from(*keep), !kept))).collect();
        rays.chunks(self.simulated.columns()).map(<[_]>::to_vec).collect()
    }
}

impl Pairs {
    /// Adds a pair of rays, each with its probability of being lost and whether it was.
    fn add(&mut self, (p, p_lost): (f64, bool), (q, q_lost): (f64, bool)) {
        let number = |lost: bool| f64::from(u8::from(lost));
        self.lost += f64::midpoint(number(p_lost), number(q_lost));
        self.both += number(p_lost && q_lost);
        self.alone += p * q;
        self.sharing += p.min(q);
    }
}

/// Logarithm of the odds that each ray is lost, `[ring, column]`; of what is empty in the scan as well nothing is said.
fn lost_odds(sample: &Sample, answer: &Answer) -> Vec<Option<f64>> {
    let odds = |keep: f32| {
        let lost = (1.0 - f64::from(keep)).clamp(1e-6, 1.0 - 1e-6);
        (lost / (1.0 - lost)).ln()
    };
    let pixels = sample.pixel.iter().zip(&answer.keep);
    pixels.map(|(pixel, keep)| (*pixel != Pixel::Empty).then(|| odds(*keep))).collect()
}

/// Numbers of columns between the two rays of a pair: 1, 2, 3, 4, 6, 8, 12 … as far as is looked.
fn lags() -> impl Iterator<Item = usize> {
    let doubling = (1..usize::BITS - 1).flat_map(|k| [1 << k, 3 << (k - 1)]);
    [1].into_iter().chain(doubling).take_while(|lag| *lag <= FARTHEST_COLUMNS)
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// Where a rising function takes a value, between −20 and 20.
fn balance(value: f64, rising: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (-20.0, 20.0);
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        if rising(middle) < value { low = middle } else { high = middle }
    }
    f64::midpoint(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: usize = 1800;

    /// A wall before 64 rings whose rays are lost in these bursts, each with a probability between 0.02 and 0.3; the answer says `told` of it.
    fn scan(seed: u64, bursts: &Bursts, told: impl Fn(f32) -> f32) -> (Sample, Answer) {
        let pixels = 64 * COLUMNS;
        let wall = RangeImage::from_channels(COLUMNS, vec![9.0; pixels], vec![0.5; pixels], vec![0; pixels]);
        let lost = |i: usize| if i % COLUMNS < COLUMNS / 2 { 0.02 } else { 0.3 };
        let (keep, mut kept) = ((0..pixels).map(|i| 1.0 - lost(i)).collect::<Vec<f32>>(), vec![]);
        RayDrop::new(bursts.clone(), 360.0 / COLUMNS as f64).sample(seed, &wall, &keep, &mut kept);
        let pixel = kept.iter().map(|kept| if *kept { Pixel::Kept } else { Pixel::Dropped }).collect();
        let sample = Sample { simulated: wall.clone(), real: wall, pixel, keep_weight: vec![1.0; pixels] };
        let keep = keep.into_iter().map(told).collect();
        (sample, Answer { range_m: vec![9.0; pixels], reflectance: vec![0.5; pixels], keep, scatter: None })
    }

    fn counted(bursts: &Bursts, told: impl Fn(f32) -> f32) -> Lost {
        let scans: Vec<_> = (0..4).map(|seed| scan(seed, bursts, &told)).collect();
        Lost::count(&scans, 360.0 / COLUMNS as f64)
    }

    fn two_lengths() -> Result<Bursts, BurstsError> {
        Bursts::new(vec![Burst { share: 0.6, azimuth_deg: 0.2 }, Burst { share: 0.3, azimuth_deg: 1.3 }])
    }

    #[test]
    fn the_bursts_that_rays_were_lost_in_are_found() -> Result<(), BurstsError> {
        let found = counted(&two_lengths()?, |keep| keep).fit()?;
        for azimuth_deg in [0.2, 0.6, 1.6, 4.0] {
            let (found, expected) = (found.together(azimuth_deg), two_lengths()?.together(azimuth_deg));
            assert!((found - expected).abs() < 0.03, "{azimuth_deg}: {found}, expected {expected}");
        }
        Ok(())
    }

    #[test]
    fn a_model_that_expects_too_few_lost_rays_everywhere_makes_no_bursts_of_them() -> Result<(), BurstsError> {
        let half_the_odds = |keep: f32| keep / (keep + (1.0 - keep) / 2.0);
        for told in [|keep| keep, half_the_odds] {
            let found = counted(&Bursts::default(), told).fit()?;
            assert!(found.together(0.0) < 0.03, "{found:?}");
        }
        Ok(())
    }

    #[test]
    fn the_table_says_what_was_counted() -> Result<(), BurstsError> {
        let table = counted(&two_lengths()?, |keep| keep).to_table(&two_lengths()?);
        let row = |starts: &str| -> Vec<f64> {
            let line = table.lines().find(|line| line.starts_with(starts)).unwrap_or_default();
            line.split(['|', '°', '%']).filter_map(|cell| cell.trim().parse().ok()).collect()
        };
        // The lost rays are nearly all among those of probability 0.3: that is what one expects beside them, if each is for itself. Of such rays
        // 0.7² are alone.
        let [_, real, alone, fitted] = row("| 0.2°")[..] else { panic!("{table}") };
        assert!((alone - 28.2).abs() < 1.0 && (real - fitted).abs() < 2.0 && fitted > alone + 25.0, "{table}");
        let [_, real, alone, fitted] = row("| 1 |")[..] else { panic!("{table}") };
        assert!((alone - 51.0).abs() < 2.5 && (real - fitted).abs() < 2.0 && fitted < alone - 20.0, "{table}");
        Ok(())
    }

    #[test]
    fn pairs_are_looked_at_from_next_to_each_other_on() {
        assert_eq!(lags().collect::<Vec<_>>(), [1, 2, 3, 4, 6, 8, 12, 16, 24]);
    }

    #[test]
    fn scans_that_lost_nothing_have_no_bursts() -> Result<(), BurstsError> {
        let (mut sample, answer) = scan(1, &Bursts::default(), |keep| keep);
        sample.pixel.fill(Pixel::Kept);
        assert!(Lost::count(&[(sample, answer)], 0.2).fit()?.is_empty());
        assert!(Lost::count(&[], 0.2).fit()?.is_empty());
        Ok(())
    }
}
