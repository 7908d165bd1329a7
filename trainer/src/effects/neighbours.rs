//! Values of the pixels beside a pixel.

use burn::tensor::{Tensor, s};

/// The image moved so that each pixel holds what the pixel `down` rings below it and `right` columns after it held. Columns wrap; beyond
/// the first and last ring there is `fill`.
pub(crate) fn at(x: &Tensor<3>, down: i64, right: i64, fill: f64) -> Tensor<3> {
    columns(rings(x.clone(), down, fill), right)
}

fn columns(x: Tensor<3>, right: i64) -> Tensor<3> {
    let columns = x.dims()[2] as i64;
    let right = right.rem_euclid(columns);
    if right == 0 {
        return x;
    }
    Tensor::cat(vec![x.clone().slice(s![.., .., right..columns]), x.slice(s![.., .., 0..right])], 2)
}

fn rings(x: Tensor<3>, down: i64, fill: f64) -> Tensor<3> {
    let rings = x.dims()[1] as i64;
    let beyond = |x: &Tensor<3>, n: i64| x.clone().slice(s![.., 0..n, ..]) * 0.0 + fill;
    match down.clamp(-rings, rings) {
        0 => x,
        d if d.abs() == rings => x * 0.0 + fill,
        d if d > 0 => Tensor::cat(vec![x.clone().slice(s![.., d..rings, ..]), beyond(&x, d)], 1),
        d => Tensor::cat(vec![beyond(&x, -d), x.slice(s![.., 0..rings + d, ..])], 1),
    }
}
