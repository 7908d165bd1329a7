//! How well classes are told: intersection over union and pixel accuracy, over all pixels of all scans together.

use serde::{Deserialize, Serialize};

use super::classes::{CLASSES, NAMES};

/// Pixels by (true class, predicted class).
#[derive(Clone, Debug, Default)]
pub struct Confusion {
    pixels: [[u64; CLASSES]; CLASSES],
}

/// Scores over a set of scans.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SegmentationScore {
    /// What was scored.
    pub of: String,
    /// Scans.
    pub scans: usize,
    /// Share of the labelled returns that got their class.
    pub pixel_accuracy: f64,
    /// Mean of the classes' intersection over union, over the classes that these scans hold.
    pub mean_iou: f64,
    /// Each class's, by name; absent where these scans hold none of it.
    pub iou: Vec<(String, f64)>,
}

impl Confusion {
    /// Counts a pixel.
    pub fn add(&mut self, truth: usize, predicted: usize) {
        self.pixels[truth][predicted] += 1;
    }

    /// The scores of what was counted.
    pub fn score(&self, of: &str, scans: usize) -> SegmentationScore {
        let right = |c: usize| self.pixels[c][c];
        let are = |c: usize| self.pixels[c].iter().sum::<u64>();
        let called = |c: usize| self.pixels.iter().map(|row| row[c]).sum::<u64>();
        let iou: Vec<(String, f64)> = (0..CLASSES)
            .filter(|c| are(*c) > 0)
            .map(|c| (NAMES[c].to_owned(), right(c) as f64 / (are(c) + called(c) - right(c)) as f64))
            .collect();
        let total: u64 = (0..CLASSES).map(are).sum();
        SegmentationScore {
            of: of.into(),
            scans,
            pixel_accuracy: (0..CLASSES).map(right).sum::<u64>() as f64 / total as f64,
            mean_iou: iou.iter().map(|(_, iou)| iou).sum::<f64>() / iou.len() as f64,
            iou,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_class_that_takes_a_quarter_of_another_costs_both() {
        let mut confusion = Confusion::default();
        for _ in 0..3 {
            confusion.add(0, 0);
        }
        confusion.add(0, 2);
        for _ in 0..4 {
            confusion.add(2, 2);
        }
        let score = confusion.score("made up", 1);
        assert!((score.pixel_accuracy - 7.0 / 8.0).abs() < 1e-12);
        // 3 of 4, and 4 of 5; classes that are not there do not count.
        assert!((score.mean_iou - 0.5 * (0.75 + 0.8)).abs() < 1e-12);
        assert_eq!(score.iou.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["vehicle", "road"]);
    }
}
