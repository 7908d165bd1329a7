//! What a generator's answer shows once rays are lost.

use burn::tensor::Tensor;

use super::view::Coding;
use crate::network::Generated;

/// Temperature of the Gumbel-sigmoid; the paper's α.
pub(crate) const ALPHA: f64 = 1.0;

/// How answers lose rays.
#[derive(Clone, Copy, Debug)]
pub struct Reporting {
    /// What a lost ray shows.
    pub coding: Coding,
    /// Whether the generator's logit decides; otherwise its image shows lost rays as it shows everything else.
    pub ray_drop: bool,
}

/// The uniform numbers that draw an answer, each `[batch, 1, ring, column]`.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// Which rays are reported.
    pub ray_drop: Tensor<4>,
    /// Which reflectances they have, where these scatter.
    pub scatter: Tensor<4>,
}

/// An answer as a discriminator sees it.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Range code and reflectance, `[batch, 2, ring, column]`.
    pub image: Tensor<4>,
    /// 1 where the ray is reported, as far as that is decided apart from the image, else 0, `[batch, 1, ring, column]`.
    pub reported: Tensor<4>,
}

impl Reporting {
    /// The answer to a scan whose rays may be reported where `possible` is 1, `[batch, 1, ring, column]`.
    ///
    /// What comes of a simulated ray that hits nothing is decided by the simulation, in training as in the service: nothing.
    pub fn answer(&self, generated: &Generated, possible: Tensor<4>, chance: Drawn) -> Answer {
        let reported = if self.ray_drop { generated.reported(chance.ray_drop, ALPHA) * possible } else { possible };
        Answer { image: self.coding.report(generated.drawn(chance.scatter), &reported), reported }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{RangeCode, RangeCoder};
    use crate::translation::Unreported;
    use burn::tensor::{Device, TensorData};

    #[test]
    fn what_hits_nothing_is_never_reported_and_what_is_lost_shows_as_lost() {
        let device = Device::flex();
        let row = |x: [f32; 4]| Tensor::<4>::from_data(TensorData::new(x.to_vec(), [1, 1, 1, 4]), &device);
        let range = RangeCoder { code: RangeCode::Logarithmic, limits_m: (1.0, 100.0) };
        let shown = |ray_drop: bool| {
            let reporting = Reporting { coding: Coding { range, unreported: Unreported::MinusOne }, ray_drop };
            let image = Tensor::zeros([1, 2, 1, 4], &device) + 0.3;
            let generated = Generated { image, keep_logit: row([9.0, 9.0, -9.0, -9.0]), scatter: None };
            let chance = Drawn { ray_drop: row([0.5; 4]), scatter: row([0.5; 4]) };
            let answer = reporting.answer(&generated, row([1.0, 0.0, 1.0, 0.0]), chance);
            answer.image.into_data().iter::<f32>().take(4).collect::<Vec<_>>()
        };
        for (found, expected) in shown(true).iter().zip([0.3, -1.0, -1.0, -1.0]) {
            assert!((found - expected).abs() < 1e-6);
        }
        for (found, expected) in shown(false).iter().zip([0.3, -1.0, 0.3, -1.0]) {
            assert!((found - expected).abs() < 1e-6);
        }
    }
}
