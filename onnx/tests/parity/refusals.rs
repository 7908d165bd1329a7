//! What cannot be exported says why, and names the operation.

use burn::tensor::{Distribution, Int, Tensor, s};
use onnx::{Axis, Error, Exporter};

use crate::sample::{Function, floats};

fn exporter() -> Exporter {
    let column = Axis::new("column", 8).on("x", 3);
    Exporter::new().input("x").output("y").dynamic(Axis::new("batch", 1).on("x", 0)).dynamic(column)
}

fn refused_by(exporter: &Exporter, forward: impl Fn(Tensor<4>) -> Tensor<4>) -> Error {
    let inputs = |sizes: &onnx::Sizes| floats([sizes["batch"], 3, 4, sizes["column"]], 1);
    exporter.export(&Function {}, inputs, |_, x| forward(x)).unwrap_err()
}

fn refused(forward: impl Fn(Tensor<4>) -> Tensor<4>) -> String {
    refused_by(&exporter(), forward).to_string()
}

#[test]
fn an_operation_without_counterpart_is_named() {
    let message = refused(|x| x.sort(3));
    assert_eq!(message, "operation 0, NumericFloat::Sort → [2, 3, 4, 8]: no ONNX counterpart");
    let message = refused(|x| x.exp().cumprod(3));
    assert_eq!(message, "operation 1, NumericFloat::CumProd → [2, 3, 4, 8]: no ONNX counterpart");
}

#[test]
fn random_numbers_are_asked_to_become_an_input() {
    let message = refused(|x| x.random_like(Distribution::Default) + x);
    assert!(message.starts_with("operation 0, Float::Random"), "{message}");
    assert!(message.ends_with("make the noise an input"), "{message}");
}

#[test]
fn a_number_made_of_a_size_is_refused() {
    let message = refused(|x| {
        let w = x.dims()[3];
        x / w as f32
    });
    assert_eq!(
        message,
        "operation 0, NumericFloat::DivScalar → [2, 3, 4, 8]: it was given a number computed from a dynamic size: \
         [Float(8.0)] at one size, [Float(9.0)] at another"
    );
}

#[test]
fn a_setting_made_of_a_size_is_refused() {
    let message = refused(|x| {
        let w = x.dims()[3];
        x.pad((0, w - 4, 0, 0), burn::tensor::ops::PadMode::Constant(0.0))
    });
    assert!(message.contains("NumericFloat::Pad") && message.contains("computed from a dynamic size"), "{message}");
}

#[test]
fn a_table_made_of_a_size_is_refused() {
    let message = refused(|x| {
        let w = x.dims()[3];
        let table: Vec<f32> = (0..w).map(|column| column as f32 / w as f32).collect();
        x.clone() * Tensor::<1>::from_floats(table.as_slice(), &x.device()).reshape([1, 1, 1, w])
    });
    assert!(
        message.starts_with("tensor `constant`: a constant built from a dynamic size (shapes [[8], [8], [9],"),
        "{message}"
    );
}

#[test]
fn a_bound_that_was_cut_off_at_some_sizes_is_refused() {
    let message = refused(|x| x.slice(s![.., .., .., 0..10]));
    assert!(message.contains("BaseFloat::Slice") && message.contains("is not an expression"), "{message}");
}

#[test]
fn a_size_with_a_remainder_is_refused() {
    let message = refused(|x| {
        let [b, _, _, w] = x.dims();
        Tensor::<4>::zeros([b, 3, 4, w / 2], &x.device())
    });
    assert!(message.contains("BaseFloat::Zeros") && message.contains("column [8, 8, 9, "), "{message}");
}

#[test]
fn another_course_at_another_size_is_refused() {
    let error = refused_by(&exporter(), |x| if x.dims()[3] > 8 { x.exp() } else { x.sin() });
    assert!(matches!(error, Error::Diverging { index: 0, .. }), "{error}");
    assert!(
        error.to_string().contains("is Float::Sin at batch 2, column 8, but Float::Exp at batch 2, column 9"),
        "{error}"
    );
    let error = refused_by(&exporter(), |x| (8..x.dims()[3]).fold(x, |x, _| x.exp()));
    assert!(matches!(error, Error::Diverging { .. }), "{error}");
}

#[test]
fn a_constant_from_another_device_is_refused() {
    let error = refused_by(&exporter(), |_| floats([1, 3, 4, 8], 1));
    assert!(matches!(error, Error::ForeignTensor), "{error}");
}

#[test]
fn names_and_axes_must_fit_the_forward_pass() {
    let refused = |exporter: Exporter| refused_by(&exporter, |x| x + 1.0).to_string();
    let axis = || Axis::new("more", 4);
    assert_eq!(
        refused(exporter().output("z")),
        "output names: the forward pass has 1 output tensors, but 2 names were given"
    );
    assert_eq!(refused(exporter().input("y")), "the name `y` is given to two inputs or outputs");
    assert_eq!(refused(exporter().dynamic(axis().on("z", 0))), "dynamic axis `more`: no input is called `z`");
    assert!(refused(exporter().dynamic(axis())).contains("0 places"));
    assert!(refused(exporter().dynamic(axis().multiple_of(3).on("x", 2))).contains("multiple of 3"));
    assert!(refused(exporter().dynamic(Axis::new("batch", 2).on("x", 0))).contains("declared twice"));
    assert_eq!(refused(exporter().opset(17)), "opset: expected 18 to 23, found 17");
    assert_eq!(
        refused(exporter().dynamic(axis().on("x", 2)).dynamic(Axis::new("none", 7).on("x", 4))),
        "input `x`, axis 4: expected size 7, found None (did the closure use its sizes?)"
    );
}

#[test]
fn a_free_axis_must_be_declared_on_every_input_that_has_it() {
    let exporter = Exporter::new().input("a").input("b").output("y").dynamic(Axis::new("column", 8).on("a", 0));
    let inputs = |sizes: &onnx::Sizes| (floats([sizes["column"]], 1), floats([sizes["column"]], 2));
    let error = exporter.export(&Function {}, inputs, |_, (a, b): (Tensor<1>, Tensor<1>)| a + b).unwrap_err();
    assert!(matches!(&error, Error::UndeclaredAxis { input, axis: 0, .. } if input == "b"), "{error}");
}

#[test]
fn an_integer_ramp_is_no_table() {
    let inputs = |sizes: &onnx::Sizes| floats([sizes["batch"], 3, 4, sizes["column"]], 1);
    let ramp = |_: &Function, x: Tensor<4>| {
        let w = x.dims()[3];
        x.clone() * Tensor::<1, Int>::arange(0..w as i64, &x.device()).float().reshape([1, 1, 1, w])
    };
    assert!(exporter().export(&Function {}, inputs, ramp).is_ok());
}
