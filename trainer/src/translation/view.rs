//! How a scan in physical units becomes what the networks see, and back.

use burn::tensor::{Tensor, s};
use lidar::label::CLASSES;
use serde::{Deserialize, Serialize};

use crate::network::{RangeCode, RangeCoder};

/// What an image shows of a ray without a return, in range code and in reflectance.
///
/// It is the same in both domains and nothing is filled in either: networks cannot tell simulated from real by the filling. What a
/// simulated ray that hits nothing and a real ray that was not reported have in common is that the scan holds nothing of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unreported {
    /// −1, as the authors' code has it: a range code that no return has.
    #[default]
    MinusOne,
    /// 0, as the paper's equation 6 has it (mask ⊙ image): the code of some range and of a reflectance of ½.
    Zero,
}

impl Unreported {
    /// The value.
    pub fn value(self) -> f32 {
        match self {
            Self::MinusOne => -1.0,
            Self::Zero => 0.0,
        }
    }
}

/// Between physical units and what networks see.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coding {
    /// Of ranges.
    pub range: RangeCoder,
    /// Of rays without a return.
    pub unreported: Unreported,
}

/// Scans as networks see them.
#[derive(Clone, Debug)]
pub struct View {
    /// Range code and reflectance, −1 to 1, `[batch, 2, ring, column]`.
    pub image: Tensor<4>,
    /// Semantic class, −1 (unlabelled) to 1, `[batch, 1, ring, column]`.
    pub condition: Tensor<4>,
    /// 1 where there is a return, else 0, `[batch, 1, ring, column]`.
    pub returned: Tensor<4>,
}

impl View {
    /// These scans, and after them others, in one batch.
    #[must_use]
    pub fn beside(&self, other: &Self) -> Self {
        let both = |a: &Tensor<4>, b: &Tensor<4>| Tensor::cat(vec![a.clone(), b.clone()], 0);
        Self {
            image: both(&self.image, &other.image),
            condition: both(&self.condition, &other.condition),
            returned: both(&self.returned, &other.returned),
        }
    }
}

impl Coding {
    /// A scan as networks see it; `scan` is `[batch, 3, ring, column]`: range in m, reflectance 0–1, class.
    pub fn view(&self, scan: &Tensor<4>) -> View {
        let channel = |i: usize| scan.clone().slice(s![.., i..i + 1, .., ..]);
        let returned = channel(0).greater_elem(0.0).float();
        let image = Tensor::cat(vec![self.range.encode(channel(0)), channel(1) * 2.0 - 1.0], 1);
        let condition = channel(2) * (2.0 / (CLASSES - 1) as f32) - 1.0;
        View { image: self.report(image, &returned), condition, returned }
    }

    /// An image of which only the rays in the `mask` are reported.
    pub fn report(&self, image: Tensor<4>, mask: &Tensor<4>) -> Tensor<4> {
        let nothing = self.unreported.value();
        (image - nothing) * mask.clone() + nothing
    }

    /// The ranges in m, within the sensor's limits, that an image `[batch, 2, ring, column]` shows.
    pub fn range_m(&self, image: &Tensor<4>) -> Tensor<4> {
        let (near, far) = self.range.limits_m;
        let code = image.clone().slice(s![.., 0..1, .., ..]).clamp(-1.0, 1.0);
        self.range.decode(code).clamp(near, far)
    }

    /// The reflectances, 0–1, that an image `[batch, 2, ring, column]` shows.
    pub fn reflectance(&self, image: &Tensor<4>) -> Tensor<4> {
        (image.clone().slice(s![.., 1..2, .., ..]) + 1.0).clamp(0.0, 2.0) / 2.0
    }

    /// 1 where an image shows a return, `[batch, 1, ring, column]`, if it says so by its range code alone: where the code is nearer to the
    /// nearest return's than to nothing's. Inverse codes of far returns are close to −1, so there anything beyond nine tenths of the
    /// farthest range counts as nothing.
    pub fn shows_return(&self, image: &Tensor<4>) -> Tensor<4> {
        let code = image.clone().slice(s![.., 0..1, .., ..]);
        let (near, far) = self.range.limits_m;
        let part = match self.range.code {
            RangeCode::Logarithmic => near.ln_1p() / far.ln_1p() / 2.0,
            RangeCode::Inverse => ((0.9 * far).recip() - far.recip()) / (near.recip() - far.recip()),
        };
        code.greater_elem(2.0 * part - 1.0).float()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, TensorData};

    fn coding(code: RangeCode, unreported: Unreported) -> Coding {
        Coding { range: RangeCoder { code, limits_m: (0.9, 120.0) }, unreported }
    }

    /// Four rays: nothing, 1 m, 10 m, 100 m.
    fn scan() -> Tensor<4> {
        let values = vec![0f32, 1.0, 10.0, 100.0, 0.0, 0.2, 0.5, 1.0, 0.0, 9.0, 13.0, 19.0];
        Tensor::from_data(TensorData::new(values, [1, 3, 1, 4]), &Device::flex())
    }

    fn values(x: Tensor<4>) -> Vec<f32> {
        x.into_data().iter::<f32>().collect()
    }

    #[test]
    fn what_networks_see_comes_back_in_physical_units() {
        for code in [RangeCode::Logarithmic, RangeCode::Inverse] {
            let coding = coding(code, Unreported::MinusOne);
            let view = coding.view(&scan());
            assert_eq!(values(view.returned), [0.0, 1.0, 1.0, 1.0]);
            assert_eq!(values(view.condition), [-1.0, 9.0 / 9.5 - 1.0, 13.0 / 9.5 - 1.0, 1.0]);
            let (range, reflectance) = (values(coding.range_m(&view.image)), values(coding.reflectance(&view.image)));
            for (i, (range_m, expected)) in [(1.0, 0.2), (10.0, 0.5), (100.0, 1.0)].into_iter().enumerate() {
                assert!((range[i + 1] - range_m).abs() < 1e-3 * range_m, "{code:?} {range:?}");
                assert!((reflectance[i + 1] - expected).abs() < 1e-6, "{reflectance:?}");
            }
        }
    }

    #[test]
    fn a_ray_without_a_return_shows_the_same_whoever_lost_it() {
        for unreported in [Unreported::MinusOne, Unreported::Zero] {
            let coding = coding(RangeCode::Logarithmic, unreported);
            let view = coding.view(&scan());
            let full = Tensor::<4>::zeros([1, 2, 1, 4], &Device::flex()) + 0.3;
            let dropped = values(coding.report(full, &view.returned));
            let image = values(view.image);
            assert_eq!([image[0], image[4]], [unreported.value(); 2]);
            assert_eq!([dropped[0], dropped[4]], [image[0], image[4]]);
        }
    }

    #[test]
    fn codes_alone_tell_returns_from_nothing() {
        for code in [RangeCode::Logarithmic, RangeCode::Inverse] {
            let coding = coding(code, Unreported::MinusOne);
            assert_eq!(values(coding.shows_return(&coding.view(&scan()).image)), [0.0, 1.0, 1.0, 1.0], "{code:?}");
        }
    }
}
