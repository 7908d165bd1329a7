//! Resizing: where each runtime puts the samples.

use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions};
use burn::tensor::{Tensor, s};

use crate::comparison::{At, function_agrees, image};
use crate::sample::floats;

/// To twice the height and `columns` of `[…, column]`.
fn resized(x: Tensor<4>, mode: InterpolateMode, align_corners: bool, columns: impl Fn(usize) -> usize) -> Tensor<4> {
    let [_, _, h, w] = x.dims();
    let options = InterpolateOptions::new(mode).with_align_corners(align_corners).with_output_size([2 * h, columns(w)]);
    interpolate(x, options)
}

#[test]
fn nearest_repeats_samples() {
    function_agrees(image, |x| resized(x, InterpolateMode::Nearest, false, |w| 2 * w));
    function_agrees(image, |x| resized(x, InterpolateMode::Nearest, true, |w| 4 * w));
}

#[test]
fn bilinear_knows_both_conventions_of_corners() {
    function_agrees(image, |x| resized(x, InterpolateMode::Bilinear, true, |w| 2 * w));
    function_agrees(image, |x| resized(x, InterpolateMode::Bilinear, false, |w| 2 * w));
    function_agrees(image, |x| resized(x, InterpolateMode::Bilinear, false, |_| 7));
}

#[test]
fn bicubic_has_the_same_coefficient() {
    function_agrees(image, |x| resized(x, InterpolateMode::Bicubic, false, |w| 2 * w));
}

/// 7 columns to 10: a float factor would give 9.
#[test]
fn a_broken_factor_keeps_the_output_size() {
    let fixed = |at: At| floats([at.batch, 3, 4, 7], 1);
    function_agrees(fixed, |x| resized(x, InterpolateMode::Bilinear, false, |_| 10));
    function_agrees(fixed, |x| resized(x, InterpolateMode::Nearest, false, |_| 10));
}

#[test]
fn an_image_resized_to_the_size_of_another_follows_it() {
    let pair = |at: At| (image(at), floats([at.batch, 1, 9, at.column], 2));
    function_agrees(pair, |(x, target): (Tensor<4>, Tensor<4>)| {
        let [_, _, h, w] = target.dims();
        let small = x.slice(s![.., .., ..;2, ..;2]);
        let options = InterpolateOptions::new(InterpolateMode::Nearest).with_output_size([h, w]);
        interpolate(small, options) + target
    });
}
