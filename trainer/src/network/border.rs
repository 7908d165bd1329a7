//! How a range image goes on beyond its edges.

use burn::tensor::ops::PadMode;
use burn::tensor::{Tensor, s};
use serde::{Deserialize, Serialize};

/// What lies beside the first and the last column; above the top ring and below the last one an image is always mirrored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Border {
    /// The other end: of a whole turn, the first column follows the last.
    #[default]
    Turn,
    /// The same columns backwards, as CLS2R has it; and of a cut-out, whose ends are no neighbours.
    Mirror,
}

impl Border {
    /// An image `[batch, channel, ring, column]`, continued by so many pixels on every side.
    pub fn pad(self, x: Tensor<4>, by: usize) -> Tensor<4> {
        let x = x.pad([(by, by), (0, 0)], PadMode::Reflect);
        match self {
            Self::Mirror => x.pad([(by, by)], PadMode::Reflect),
            Self::Turn => {
                let columns = x.dims()[3];
                let before = x.clone().slice(s![.., .., .., columns - by..columns]);
                let after = x.clone().slice(s![.., .., .., 0..by]);
                Tensor::cat(vec![before, x, after], 3)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, TensorData};

    fn padded(border: Border) -> Vec<f32> {
        let image = TensorData::new(vec![1f32, 2.0, 3.0, 4.0, 5.0, 6.0], [1, 1, 2, 3]);
        border.pad(Tensor::from_data(image, &Device::flex()), 1).into_data().iter::<f32>().collect()
    }

    #[test]
    fn a_turn_closes_and_a_cut_out_is_mirrored() {
        let turn = [6., 4., 5., 6., 4., 3., 1., 2., 3., 1., 6., 4., 5., 6., 4., 3., 1., 2., 3., 1.];
        let mirror = [5., 4., 5., 6., 5., 2., 1., 2., 3., 2., 5., 4., 5., 6., 5., 2., 1., 2., 3., 2.];
        assert_eq!(padded(Border::Turn), turn);
        assert_eq!(padded(Border::Mirror), mirror);
    }
}
