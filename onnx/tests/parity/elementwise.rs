//! Functions of single elements.

use burn::tensor::activation;
use burn::tensor::{DType, Tensor};

use crate::comparison::{At, function_agrees, image, images};
use crate::sample::{floats_between, integers, truths};

macro_rules! functions {
    ($($name:ident: $inputs:expr, $forward:expr;)+) => { $(#[test] fn $name() { function_agrees($inputs, $forward); })+ };
}

fn positive(at: At) -> Tensor<4> {
    floats_between([at.batch, 3, 4, at.column], 7, 0.05, 5.0)
}

fn small(at: At) -> Tensor<4> {
    floats_between([at.batch, 3, 4, at.column], 7, -0.95, 0.95)
}

/// Halves and whole numbers, where rounding has to choose.
fn halves(at: At) -> Tensor<4> {
    (image(at) * 4.0).floor() / 2.0
}

fn numbers(at: At) -> Tensor<4, burn::tensor::Int> {
    integers([at.batch, 3, 4, at.column], 3, 9) - 4
}

functions! {
    exp_is_exp: image, Tensor::<4>::exp;
    log_is_log: positive, |x: Tensor<4>| x.log();
    log1p_is_log_of_one_plus: positive, |x: Tensor<4>| x.log1p();
    sqrt_is_sqrt: positive, |x: Tensor<4>| x.sqrt();
    recip_is_reciprocal: positive, |x: Tensor<4>| x.recip();
    sine_cosine_and_tangent: small, |x: Tensor<4>| (x.clone().sin(), x.clone().cos(), x.tan());
    hyperbolic_functions: small, |x: Tensor<4>| (x.clone().sinh(), x.clone().cosh(), x.tanh());
    inverse_circular_functions: small, |x: Tensor<4>| (x.clone().asin(), x.clone().acos(), x.atan());
    inverse_hyperbolic_functions: small, |x: Tensor<4>| (x.clone().asinh(), (x.clone() + 2.5).acosh(), x.atanh());
    erf_is_erf: image, Tensor::<4>::erf;
    rounding_takes_the_even_half: halves, |x: Tensor<4>| (x.clone().round(), x.clone().floor(), x.clone().ceil(), x.trunc());
    signs_and_magnitudes: halves, |x: Tensor<4>| (x.clone().abs(), x.clone().neg(), x.sign());
    not_a_number_and_infinity: image, |x: Tensor<4>| (x.clone().log().is_nan(), (x / 0.0).is_inf());

    sums_and_products: images, |(a, b): (Tensor<4>, Tensor<4>)| (a.clone() + b.clone(), a.clone() - b.clone(), a.clone() * b.clone(), a / b);
    sums_and_products_with_scalars: image, |x: Tensor<4>| (x.clone() + 0.3, x.clone() - 0.7, x.clone() * 1.9, x / 0.37);
    remainders_have_the_sign_of_the_divisor: images, |(a, b): (Tensor<4>, Tensor<4>)| (a.clone().remainder(b.sign() * 0.75), a.remainder_scalar(0.7));
    hypotenuse: images, |(a, b): (Tensor<4>, Tensor<4>)| a.hypot(b);
    whole_powers_of_negative_numbers: image, |x: Tensor<4>| (x.clone().powi_scalar(2), x.clone().powi_scalar(3), x.square());
    broken_powers: |at| (positive(at), image(at)), |(a, b): (Tensor<4>, Tensor<4>)| (a.clone().powf_scalar(-1.7), a.powf(b));
    powers_by_tensors: |at| (image(at), numbers(at).abs()), |(a, b): (Tensor<4>, Tensor<4, burn::tensor::Int>)| (a.powi(b.clone().float()), b.clone().powi_scalar(3), b.clone().powi(b));
    clamps: image, |x: Tensor<4>| (x.clone().clamp(-0.5, 0.7), x.clone().clamp_min(0.2), x.clamp_max(-0.1));
    larger_and_smaller_of_two: images, |(a, b): (Tensor<4>, Tensor<4>)| (a.clone().max_pair(b.clone()), a.min_pair(b));

    comparisons: images, |(a, b): (Tensor<4>, Tensor<4>)| (
        a.clone().greater(b.clone()), a.clone().greater_equal(b.clone()), a.clone().lower(b.clone()), a.lower_equal(b),
    );
    comparisons_with_scalars: halves, |x: Tensor<4>| (
        x.clone().greater_elem(0.5), x.clone().greater_equal_elem(0.5), x.clone().lower_elem(0.5), x.lower_equal_elem(0.5),
    );
    equality: |at| (halves(at), halves(at).flip([3])), |(a, b): (Tensor<4>, Tensor<4>)| (
        a.clone().equal(b.clone()), a.clone().not_equal(b), a.clone().equal_elem(0.5), a.not_equal_elem(0.5),
    );
    truth_tables: |at: At| (truths([at.batch, at.column], 1), truths([at.batch, at.column], 2)), |(a, b): (Tensor<2, _>, Tensor<2, _>)| (
        a.clone().bool_and(b.clone()), a.clone().bool_or(b.clone()), a.clone().bool_xor(b.clone()), a.bool_not().equal(b),
    );
    truths_are_equal_or_not: |at: At| (truths([at.batch, at.column], 1), truths([at.batch, at.column], 2)), |(a, b): (Tensor<2, _>, Tensor<2, _>)| (a.clone().equal(b.clone()), a.not_equal(b));
    element_types_change: image, |x: Tensor<4>| (x.clone().cast(DType::F64).exp().cast(DType::F32), x.int().cast(DType::I32).float());
    truth_becomes_numbers: |at: At| truths([at.batch, at.column], 1), |x: Tensor<2, _>| (x.clone().float(), x.int());
    floats_become_integers_towards_zero: image, |x: Tensor<4>| ((x.clone() * 3.0).int(), (x * 3.0).int().float());
    arithmetic_of_integers: |at| (numbers(at), numbers(at).flip([3])), |(a, b): (Tensor<4, burn::tensor::Int>, Tensor<4, burn::tensor::Int>)| (
        a.clone() * b.clone() + 3, a.clone() / 2 - b.clone(), a.clone().remainder_scalar(3), a.clamp(-2, 2).abs().max_pair(b),
    );

    relu_and_its_kin: image, |x: Tensor<4>| (activation::relu(x.clone()), activation::leaky_relu(x.clone(), 0.17), activation::prelu(x.clone(), Tensor::from_floats([0.1, 0.2, 0.3], &x.device())));
    sigmoid_and_its_kin: image, |x: Tensor<4>| (activation::sigmoid(x.clone()), activation::log_sigmoid(x.clone()), activation::hard_sigmoid(x.clone(), 0.2, 0.5), activation::silu(x));
    gelu_and_softplus: image, |x: Tensor<4>| (activation::gelu(x.clone()), activation::softplus(x.clone(), 1.0), activation::mish(x));
    softmax_and_its_kin: image, |x: Tensor<4>| (activation::softmax(x.clone(), 1), activation::log_softmax(x.clone(), 3), activation::softmin(x, 3));
}

/// All quarters, the axes between them and the origin.
#[test]
fn atan2_knows_every_quarter() {
    let plane = |at: At| {
        let (y, x) = images(at);
        let snap = |t: Tensor<4>| t.clone().mask_fill(t.abs().lower_elem(0.6), 0.0);
        (snap(y), snap(x))
    };
    function_agrees(plane, |(y, x): (Tensor<4>, Tensor<4>)| y.atan2(x));
}

#[test]
fn masks_choose() {
    let inputs = |at: At| (image(at), image(at) * 3.0, truths([at.batch, 3, 4, at.column], 5));
    function_agrees(inputs, |(a, b, mask): (Tensor<4>, Tensor<4>, Tensor<4, burn::tensor::Bool>)| {
        (a.clone().mask_where(mask.clone(), b), a.mask_fill(mask, 0.25))
    });
}
