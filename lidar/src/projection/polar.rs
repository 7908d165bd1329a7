//! Range and azimuth of every point of a cloud.

#![allow(
    clippy::inline_always,
    reason = "a loop is compiled for the processor at hand only where all of it is inlined"
)]

use pulp::Arch;

use super::Report;
use crate::azimuth::turns;
use crate::cloud::PointCloud;

/// Range and azimuth of each point, in memory that is kept from scan to scan.
#[derive(Clone, Debug, Default)]
pub(crate) struct Polar {
    /// Range in metres; NaN or infinite where the point has no finite one.
    pub(crate) range_m: Vec<f32>,
    /// Azimuth in turns, −½ to ½, 0 straight ahead; any number where the range is no positive finite number.
    pub(crate) turns: Vec<f32>,
}

impl Polar {
    /// Takes the points of this cloud.
    pub(crate) fn take(&mut self, cloud: &PointCloud) {
        self.range_m.resize(cloud.len(), 0.0);
        self.turns.resize(cloud.len(), 0.0);
        Arch::new().dispatch(
            #[inline(always)]
            || {
                let polar = self.range_m.iter_mut().zip(&mut self.turns);
                for ((((range, turn), &x), &y), &z) in polar.zip(&cloud.x).zip(&cloud.y).zip(&cloud.z) {
                    *range = (x * x + y * y + z * z).sqrt();
                    *turn = turns(x, y);
                }
            },
        );
    }

    /// Counts the points that are none, and those nearer or farther than `limits_m`.
    pub(super) fn count(&self, cloud: &PointCloud, limits_m: (f32, f32)) -> Report {
        let (zero_range, beyond, infinite) = Arch::new().dispatch(
            #[inline(always)]
            || {
                // There are fewer points than 2³²; a checked addition would keep the loop from being vectorised.
                let (mut zero_range, mut beyond, mut infinite) = (0u32, 0u32, 0u32);
                for &range in &self.range_m {
                    let (zero, finite) = (range == 0.0, range < f32::INFINITY);
                    let outside = finite && !zero && (range < limits_m.0 || range > limits_m.1);
                    zero_range = zero_range.wrapping_add(u32::from(zero));
                    infinite = infinite.wrapping_add(u32::from(!finite));
                    beyond = beyond.wrapping_add(u32::from(outside));
                }
                (zero_range, beyond, infinite)
            },
        );
        // A point too far away for its range to be a number, though its coordinates are, is beyond the limits.
        let far = |i: &usize| {
            let finite = cloud.x[*i].is_finite() && cloud.y[*i].is_finite() && cloud.z[*i].is_finite();
            finite && self.range_m[*i] == f32::INFINITY
        };
        let far = if infinite > 0 { (0..cloud.len()).filter(far).count() } else { 0 };
        Report {
            points_in: cloud.len(),
            non_finite: infinite as usize - far,
            zero_range: zero_range as usize,
            out_of_range: beyond as usize + far,
            ..Report::default()
        }
    }
}
