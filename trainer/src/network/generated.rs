//! What generators answer, in the codes of networks.

use std::ops::Range;

use burn::tensor::{Tensor, s};

/// What a generator makes of a scan.
#[derive(Clone, Debug)]
pub struct Generated {
    /// Range code and reflectance, −1 to 1 (and, where they are [corrected](super::Output::Correction), beyond), `[batch, 2, ring, column]`.
    pub image: Tensor<4>,
    /// Logit of the probability that the ray is reported, `[batch, 1, ring, column]`.
    pub keep_logit: Tensor<4>,
    /// Mean distance of reported reflectances from the image's, in its code, `[batch, 1, ring, column]`; where the network says it.
    pub scatter: Option<Tensor<4>>,
}

impl Generated {
    /// What was made of these scans of a batch.
    #[must_use]
    pub fn scans(&self, numbers: Range<usize>) -> Self {
        let of = |x: &Tensor<4>| x.clone().slice(s![numbers.clone()]);
        Self { image: of(&self.image), keep_logit: of(&self.keep_logit), scatter: self.scatter.as_ref().map(of) }
    }
}
