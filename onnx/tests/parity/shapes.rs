//! Shapes, indices, reductions and padding, with batch and column free.

use burn::tensor::ops::PadMode;
use burn::tensor::{Bool, Int, Tensor, s};

use crate::comparison::{At, function_agrees, image, images};
use crate::sample::{floats, integers, truths};

macro_rules! functions {
    ($($name:ident: $inputs:expr, $forward:expr;)+) => { $(#[test] fn $name() { function_agrees($inputs, $forward); })+ };
}

fn indexed(at: At) -> (Tensor<4>, Tensor<4, Int>) {
    (image(at), integers([at.batch, 3, 4, at.column], 9, at.column))
}

functions! {
    slices_from_the_front_and_the_back: image, |x: Tensor<4>| {
        let w = x.dims()[3];
        (x.clone().slice(s![.., 1..2, .., 2..]), x.clone().slice(s![.., .., .., w - 2..w]), x.clone().slice(s![.., .., 1..3, 1..w - 1]))
    };
    slices_with_steps: image, |x: Tensor<4>| {
        (x.clone().slice(s![.., .., ..;2, ..]), x.clone().slice(s![.., .., .., 1..;2]), x.clone().slice(s![.., .., 0..3;-1, ..;-2]), x.slice(s![.., .., .., 1..;-1]))
    };
    slices_that_follow_a_size: image, |x: Tensor<4>| {
        let [b, _, _, w] = x.dims();
        (x.clone().slice(s![0..b, .., .., w - 3..w - 1]), x.clone().narrow(3, 1, w - 1), x.clone().slice(s![b - 1..b, .., .., ..]))
    };
    flips: image, |x: Tensor<4>| (x.clone().flip([3]), x.flip([0, 2]));
    circular_columns_by_slice_and_cat: image, |x: Tensor<4>| {
        let w = x.dims()[3];
        Tensor::cat(vec![x.clone().slice(s![.., .., .., w - 3..w]), x.clone(), x.slice(s![.., .., .., 0..3])], 3)
    };
    cat_stack_and_chunk: images, |(a, b): (Tensor<4>, Tensor<4>)| {
        let joined = Tensor::cat(vec![a.clone(), b.clone()], 1);
        (Tensor::stack::<5>(vec![a, b], 1), joined.clone().slice(s![.., 2..5, .., ..]), joined.chunk(2, 1).remove(1))
    };
    permutations: image, |x: Tensor<4>| (x.clone().permute([0, 2, 3, 1]), x.clone().swap_dims(1, 3), x.transpose());
    reshapes_around_free_axes: image, |x: Tensor<4>| {
        let [b, c, h, w] = x.dims();
        (x.clone().reshape([b, c * h * w]), x.clone().reshape([b, h, c, w]), x.clone().flatten::<2>(0, 2), x.reshape([b * c, h, w]).tanh().reshape([b, c, h, w]))
    };
    squeezes: image, |x: Tensor<4>| (x.clone().mean_dim(1).squeeze_dim::<3>(1), x.unsqueeze_dim::<5>(2));
    expansions: image, |x: Tensor<4>| {
        let [b, _, h, w] = x.dims();
        let row = x.clone().slice(s![.., 0..1, 0..1, ..]);
        (row.clone().expand([b, 3, h, w]) * x, row.expand([b, 1, 7, w]))
    };
    repeats: image, |x: Tensor<4>| {
        let w = x.dims()[3];
        (x.clone().repeat_dim(1, 3), x.clone().repeat(&[1, 2, 1, 2]), x.slice(s![.., .., .., 0..1]).repeat_dim(3, w))
    };
    ramps_and_fills: image, |x: Tensor<4>| {
        let [b, _, h, w] = x.dims();
        let device = x.device();
        let columns = Tensor::<1, Int>::arange(0..w as i64, &device).float().reshape([1, 1, 1, w]);
        let odd = Tensor::<1, Int>::arange_step(1..2 * w as i64, 2, &device).float().reshape([1, 1, 1, w]);
        let rings = Tensor::<1, Int>::arange(0..h as i64, &device).float().reshape([1, 1, h, 1]);
        (x.clone() * columns, x.clone() - odd, x.ones_like().cumsum(3) + rings, Tensor::<4>::full([b, 1, h, w], 0.5, &device) + x.zeros_like())
    };
    running_sums: image, |x: Tensor<4>| (x.clone().cumsum(3), x.cumsum(0));
    gather_takes_by_index: indexed, |(x, index): (Tensor<4>, Tensor<4, Int>)| x.gather(3, index);
    select_takes_rows: |at: At| (image(at), integers([5], 4, 3)), |(x, index): (Tensor<4>, Tensor<1, Int>)| x.select(1, index);
    a_class_is_one_hot_by_comparison_with_a_ramp: |at: At| integers([at.batch, 1, 4, at.column], 2, 6), |class: Tensor<4, Int>| {
        let classes = Tensor::<1, Int>::arange(0..6, &class.device()).reshape([1, 6, 1, 1]);
        let [b, _, h, w] = class.dims();
        class.expand([b, 6, h, w]).equal(classes.expand([b, 6, h, w])).float()
    };
    reductions_over_an_axis: image, |x: Tensor<4>| (x.clone().mean_dim(3), x.clone().sum_dim(1), x.clone().max_dim(3), x.min_dim(2));
    reductions_over_more: image, |x: Tensor<4>| (x.clone().mean(), x.clone().sum_dims(&[1, 3]), x.clone().max(), x.prod_dim(1));
    reductions_of_everything: image, |x: Tensor<4>| (x.clone().sum(), x.clone().min(), (x * 0.7).prod());
    where_the_largest_is: image, |x: Tensor<4>| {
        let (value, index) = x.clone().max_dim_with_indices(3);
        (value, index, x.clone().argmax(1), x.argmin(3))
    };
    where_the_smallest_is: image, |x: Tensor<4>| x.min_dim_with_indices(3);
    variance_is_composed: image, |x: Tensor<4>| (x.clone().var(1), x.var_bias(2));
    any_and_all: |at: At| truths([at.batch, 3, at.column], 3), |x: Tensor<3, Bool>| (x.clone().any_dim(1), x.clone().all_dim(1), x.clone().any(), x.all());
    shapes_of_truths_and_integers: |at: At| (truths([at.batch, 3, at.column], 3), integers([at.batch, 3, at.column], 3, 9)), |(t, i): (Tensor<3, Bool>, Tensor<3, Int>)| (
        Tensor::cat(vec![t.clone(), t.clone().flip([2])], 1), t.slice(s![.., 1..2, 1..]).swap_dims(0, 2), i.clone().slice(s![.., .., 1..]).permute([2, 0, 1]), Tensor::cat(vec![i.clone(), i.flip([2])], 2),
    );
    padding: image, |x: Tensor<4>| (x.clone().pad((1, 2, 0, 3), PadMode::Constant(0.5)), x.clone().pad((2, 1, 1, 2), PadMode::Reflect), x.pad((2, 1, 1, 2), PadMode::Edge));
    products_of_integer_matrices: |at: At| (integers([at.batch, 5, at.column], 1, 9), integers([at.batch, at.column, 2], 2, 9)), |(a, b): (Tensor<3, Int>, Tensor<3, Int>)| a.matmul(b);
    products_of_matrices: |at: At| (floats([at.batch, 3, 5, at.column], 1), floats([at.batch, 3, at.column, 2], 2)), |(a, b): (Tensor<4>, Tensor<4>)| a.matmul(b) / 10.0;
}
