//! Halving and doubling without aliases: Zhang, "Making convolutional networks shift-invariant again" (2019), as CUT has it.

use burn::tensor::module::{conv_transpose2d, conv2d};
use burn::tensor::ops::{ConvOptions, ConvTransposeOptions, PadMode};
use burn::tensor::{Tensor, s};

use super::border::Border;

/// Binomial weights along an axis.
const DOWN: [f32; 3] = [1.0, 2.0, 1.0];
const UP: [f32; 4] = [1.0, 3.0, 3.0, 1.0];

/// An image `[batch, channel, ring, column]` at half the size, each channel blurred by 1 2 1 along both axes.
pub fn halve(x: Tensor<4>, border: Border) -> Tensor<4> {
    let kernel = kernel(&x, &DOWN, 1.0);
    let channels = x.dims()[1];
    conv2d(border.pad(x, 1), kernel, None, ConvOptions::new([2, 2], [0, 0], [1, 1], channels))
}

/// An image at twice the size, each channel blurred by 1 3 3 1 along both axes.
pub fn double(x: Tensor<4>, border: Border) -> Tensor<4> {
    let kernel = kernel(&x, &UP, 4.0);
    let [_, channels, rings, columns] = x.dims();
    let x = match border {
        Border::Turn => border.pad(x, 1),
        // CUT repeats the last pixel here, where it mirrors elsewhere.
        Border::Mirror => x.pad([(1, 1), (1, 1)], PadMode::Edge),
    };
    let options = ConvTransposeOptions::new([2, 2], [2, 2], [0, 0], [1, 1], channels);
    let x = conv_transpose2d(x, kernel, None, options);
    x.slice(s![.., .., 1..1 + 2 * rings, 1..1 + 2 * columns])
}

/// The product of the weights along both axes, whose sum is `sum`, once a channel of `like`.
fn kernel(like: &Tensor<4>, weights: &[f32], sum: f32) -> Tensor<4> {
    let n = weights.len();
    let total: f32 = weights.iter().sum();
    let products: Vec<f32> =
        weights.iter().flat_map(|a| weights.iter().map(move |b| a * b * sum / (total * total))).collect();
    let kernel = Tensor::<1>::from_floats(products.as_slice(), &like.device()).reshape([1, 1, n, n]);
    kernel.repeat_dim(0, like.dims()[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, TensorData};

    fn image(values: Vec<f32>, size: [usize; 2]) -> Tensor<4> {
        Tensor::from_data(TensorData::new(values, [1, 1, size[0], size[1]]), &Device::flex())
    }

    fn values(x: Tensor<4>) -> Vec<f32> {
        x.into_data().iter::<f32>().collect()
    }

    #[test]
    fn what_is_even_stays_as_it_is() {
        for border in [Border::Turn, Border::Mirror] {
            let even = image(vec![0.7; 8 * 12], [8, 12]);
            assert!(values(halve(even.clone(), border)).iter().all(|x| (x - 0.7).abs() < 1e-6));
            let doubled = double(even, border);
            assert_eq!(doubled.dims(), [1, 1, 16, 24]);
            // Above the first ring and below the last one a mirror image of even values is even too.
            assert!(values(doubled).iter().all(|x| (x - 0.7).abs() < 1e-6));
        }
    }

    /// Worked out by hand in numpy: padded as CUT pads, sums of products, every other one.
    #[test]
    fn figures_are_those_of_the_papers_code() {
        let ramp: Vec<f32> = (0..16).map(|i| (i * i) as f32).collect();
        let halved = values(halve(image(ramp.clone(), [4, 4]), Border::Mirror));
        let expected = [10.5, 20.5, 80.5, 108.5];
        for (found, expected) in halved.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-4, "{halved:?}");
        }
        let doubled = values(double(image(vec![0.0, 16.0, 32.0, 64.0], [2, 2]), Border::Mirror));
        let expected = [0., 4., 12., 16., 8., 13., 23., 28., 24., 31., 45., 52., 32., 40., 56., 64.];
        for (found, expected) in doubled.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-4, "{doubled:?}");
        }
    }
}
