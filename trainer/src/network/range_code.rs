//! Ranges as numbers from −1 to 1, as networks take and give them.

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

/// How ranges are coded; −1 is no return.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RangeCode {
    /// log₂(r + 1), 1 at the farthest range: an error of the code is an error of the range in per cent.
    #[default]
    Logarithmic,
    /// 1/r between the farthest and the nearest range, as CLS2R has it: an error of 0.01 at 50 m is one of 10 m or more.
    Inverse,
}

/// The code of ranges between a sensor's limits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RangeCoder {
    /// Which code.
    pub code: RangeCode,
    /// Nearest and farthest range, in m.
    pub limits_m: (f32, f32),
}

impl RangeCoder {
    /// The code of ranges in m, of which 0 is no return.
    pub fn encode<const D: usize>(&self, range_m: Tensor<D>) -> Tensor<D> {
        let (near, far) = self.limits_m;
        let nothing = range_m.clone().lower_equal_elem(0.0);
        let part = match self.code {
            RangeCode::Logarithmic => (range_m + 1.0).log() / far.ln_1p(),
            RangeCode::Inverse => (range_m.clamp_min(near).recip() - far.recip()) / (near.recip() - far.recip()),
        };
        (part.clamp(0.0, 1.0) * 2.0 - 1.0).mask_fill(nothing, -1.0)
    }

    /// The ranges in m of codes; −1 is 0 m where ranges are logarithmic, and the farthest where they are inverse.
    pub fn decode<const D: usize>(&self, code: Tensor<D>) -> Tensor<D> {
        let (near, far) = self.limits_m;
        let part = (code + 1.0) / 2.0;
        match self.code {
            RangeCode::Logarithmic => (part * far.ln_1p()).exp() - 1.0,
            RangeCode::Inverse => (part * (near.recip() - far.recip()) + far.recip()).recip(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    fn values(x: Tensor<1>) -> Vec<f32> {
        x.into_data().iter::<f32>().collect()
    }

    #[test]
    fn ranges_come_back_and_nothing_is_minus_one() {
        let device = Device::flex();
        let ranges = [0.0, 2.0, 10.0, 50.0, 119.0];
        for code in [RangeCode::Logarithmic, RangeCode::Inverse] {
            let coder = RangeCoder { code, limits_m: (1.0, 120.0) };
            let coded = coder.encode(Tensor::<1>::from_floats(ranges, &device));
            let back = values(coder.decode(coded.clone()));
            let coded = values(coded);
            assert!(coded[0] == -1.0 && coded.iter().all(|c| (-1.0..=1.0).contains(c)), "{coded:?}");
            for (back, range_m) in back.iter().zip(ranges).skip(1) {
                assert!((back - range_m).abs() < 1e-3 * range_m, "{code:?}: {back} for {range_m}");
            }
        }
    }

    #[test]
    fn an_error_of_a_hundredth_at_50_m() {
        let device = Device::flex();
        let off_m = |code, error: f32| {
            let coder = RangeCoder { code, limits_m: (1.0, 120.0) };
            let coded = coder.encode(Tensor::<1>::from_floats([50.0], &device));
            values(coder.decode(coded + error))[0] - 50.0
        };
        assert!((off_m(RangeCode::Logarithmic, 0.01) - 1.24).abs() < 0.01);
        assert!((off_m(RangeCode::Inverse, -0.01) - 16.4).abs() < 0.3 && off_m(RangeCode::Inverse, 0.01) < -9.0);
    }
}
