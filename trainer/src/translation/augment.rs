//! What one scan teaches of others: the same street turned, mirrored, seen by lasers that fire a little earlier or later, unlabelled.

use lidar::RangeImage;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

/// How scans of either domain are varied; labels move with what they label.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Augmentation {
    /// Whether cut-outs begin at any azimuth, round the turn.
    pub turn: bool,
    /// Whether half of the scans have left and right exchanged.
    pub mirror: bool,
    /// Most columns by which each ring by itself is moved to either side.
    pub ring_jitter_columns: usize,
    /// Share of the scans that lose their labels, so that unlabelled scans are understood too.
    pub unlabelled_share: f64,
}

impl Default for Augmentation {
    fn default() -> Self {
        Self { turn: true, mirror: true, ring_jitter_columns: 0, unlabelled_share: 0.25 }
    }
}

impl Augmentation {
    /// A cut-out of so many columns, varied by chance.
    ///
    /// # Panics
    /// If the image has fewer columns.
    pub fn cut(&self, image: &RangeImage, count: usize, rng: &mut impl Rng) -> RangeImage {
        let columns = image.columns();
        assert!(count <= columns, "{count} of {columns} columns");
        let first = rng.random_range(0..if self.turn { columns } else { columns - count + 1 });
        let mirrored = self.mirror && rng.random_bool(0.5);
        let labelled = !rng.random_bool(self.unlabelled_share);
        let reach = self.ring_jitter_columns;
        let mut out = RangeImage::empty(image.rings(), count);
        for ring in 0..image.rings() {
            let moved = first + columns + rng.random_range(0..=2 * reach) - reach;
            for column in 0..count {
                let from = ring * columns + (moved + column) % columns;
                let to = ring * count + if mirrored { count - 1 - column } else { column };
                let range_m = image.range_m()[from];
                if range_m > 0.0 {
                    let class = if labelled { image.class()[from] } else { 0 };
                    out.set(to, range_m, image.reflectance()[from], class);
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// Every pixel's range, reflectance and class say which pixel it is.
    fn image() -> RangeImage {
        let number = |i: usize| i as f32 + 1.0;
        RangeImage::from_channels(
            16,
            (0..64).map(number).collect(),
            (0..64).map(|i| number(i) / 100.0).collect(),
            (0..64).map(|i| (i % 16) as u8 + 1).collect(),
        )
    }

    fn cut(augmentation: Augmentation, seed: u64) -> RangeImage {
        augmentation.cut(&image(), 8, &mut ChaCha8Rng::seed_from_u64(seed))
    }

    #[test]
    fn labels_and_reflectance_move_with_what_they_belong_to() {
        let augmentation = Augmentation { ring_jitter_columns: 2, unlabelled_share: 0.0, ..Augmentation::default() };
        let mut mirrored = 0;
        for seed in 0..20 {
            let out = cut(augmentation, seed);
            for i in 0..32 {
                let from = out.range_m()[i] as usize - 1;
                assert_eq!(usize::from(out.class()[i]), from % 16 + 1);
                assert_eq!(from / 16, i / 8, "rings stay");
                assert!((out.reflectance()[i] - out.range_m()[i] / 100.0).abs() < 1e-6);
            }
            mirrored += usize::from((out.class()[1] + 16 - out.class()[0]) % 16 == 15);
        }
        assert!((4..=16).contains(&mirrored), "{mirrored} of 20 are mirrored");
    }

    #[test]
    fn cut_outs_that_are_not_turned_do_not_cross_the_seam() {
        let augmentation = Augmentation { turn: false, mirror: false, ..Augmentation::default() };
        for seed in 0..20 {
            let row = cut(augmentation, seed).range_m()[..8].to_vec();
            assert!(row.is_sorted(), "{row:?}");
        }
    }

    #[test]
    fn as_many_scans_lose_all_their_labels_as_was_asked_for() {
        let augmentation = Augmentation { unlabelled_share: 0.25, ..Augmentation::default() };
        let unlabelled = (0..400).filter(|seed| cut(augmentation, *seed).class().iter().all(|c| *c == 0)).count();
        // 100 are expected; four standard deviations to either side.
        assert!((65..135).contains(&unlabelled), "{unlabelled} of 400");
    }
}
