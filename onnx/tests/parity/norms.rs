//! Normalisations: one ONNX node each, with its own ε.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{
    BatchNorm, BatchNormConfig, GroupNorm, GroupNormConfig, InstanceNorm, InstanceNormConfig, LayerNorm,
    LayerNormConfig,
};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use crate::comparison::{At, Case, TOLERANCE};
use crate::runtime;
use crate::sample::{floats, scrambled};

/// `[batch, 6, 4, column]`, of a small variance, so that ε matters.
fn quiet(at: At) -> Tensor<4> {
    floats([at.batch, 6, 4, at.column], 1) * 0.05
}

fn case<M: Module>(
    norm: M,
    forward: impl Fn(&M, Tensor<4>) -> Tensor<4>,
) -> Case<M, impl Fn(At) -> Tensor<4>, impl Fn(&M, Tensor<4>) -> Tensor<4>> {
    Case { module: scrambled(norm, 3), inputs: quiet, forward, multiple: 1 }
}

fn instance(epsilon: f64) -> InstanceNorm {
    InstanceNormConfig::new(6).with_epsilon(epsilon).init(&Device::flex())
}

fn batch(epsilon: f64) -> BatchNorm {
    BatchNormConfig::new(6).with_epsilon(epsilon).init(&Device::flex())
}

/// Names of the ONNX operations in a file, by their node names `Op:output`.
pub(crate) fn count(file: &[u8], op: &str) -> usize {
    let mark = format!("{op}:");
    file.windows(mark.len()).filter(|bytes| *bytes == mark.as_bytes()).count()
}

#[test]
fn instance_norm_is_one_node() {
    let case = case(instance(1e-4), InstanceNorm::forward);
    case.agrees();
    let file = case.export();
    assert_eq!((count(&file, "InstanceNormalization"), count(&file, "Sqrt"), count(&file, "Reshape")), (1, 0, 0));
}

#[test]
fn instance_norm_without_parameters_agrees() {
    case(InstanceNormConfig::new(6).with_affine(false).init(&Device::flex()), |norm: &InstanceNorm, x| norm.forward(x))
        .agrees();
}

#[test]
fn group_norm_keeps_its_groups() {
    for groups in [1, 2, 6] {
        let case = case(GroupNormConfig::new(groups, 6).init(&Device::flex()), |norm: &GroupNorm, x| norm.forward(x));
        case.agrees();
        assert_eq!(count(&case.export(), "InstanceNormalization"), 1);
    }
}

#[test]
fn layer_norm_is_one_node() {
    let case = case(LayerNormConfig::new(6).init(&Device::flex()), |norm: &LayerNorm, x| {
        norm.forward(x.permute([0, 2, 3, 1]))
    });
    case.agrees();
    assert_eq!(count(&case.export(), "LayerNormalization"), 1);
}

#[test]
fn batch_norm_uses_its_running_statistics() {
    let case = case(batch(1e-4), BatchNorm::forward);
    case.agrees();
    assert_eq!(count(&case.export(), "BatchNormalization"), 1);
}

/// Clones of a module share running statistics: a careless move to the capture device takes them along.
#[test]
fn an_export_leaves_the_running_statistics_where_they_were() {
    let device = Device::flex();
    let case = case(batch(1e-5), BatchNorm::forward);
    let before = case.module.running_var.value().into_data();
    case.export();
    assert_eq!(case.module.running_var.value().device(), device);
    assert_eq!(case.module.running_var.value().into_data(), before);
}

/// A model under training exports as it would predict.
#[test]
fn a_model_on_an_autodiff_device_exports_its_inference() {
    let device = Device::flex().autodiff();
    let norm: BatchNorm = BatchNormConfig::new(6).init(&device);
    let train = |at: At| Tensor::<4>::from_data(quiet(at).into_data(), &device);
    norm.forward(train(At { batch: 4, column: 16 }));
    let training = Case {
        module: norm.clone(),
        inputs: train,
        forward: |norm: &BatchNorm, x: Tensor<4>| norm.forward(x),
        multiple: 1,
    };
    let valid = Case {
        module: norm.valid(),
        inputs: quiet,
        forward: |norm: &BatchNorm, x: Tensor<4>| norm.forward(x),
        multiple: 1,
    };
    let exporter = onnx::Exporter::new().input("x").output("y").dynamic(onnx::Axis::new("batch", 2).on("x", 0));
    let exporter = exporter.dynamic(onnx::Axis::new("column", 4).on("x", 3));
    let at = |sizes: &onnx::Sizes| At { batch: sizes["batch"], column: sizes["column"] };
    let file = exporter.export(&training.module, |sizes| train(at(sizes)), BatchNorm::forward).unwrap();
    assert!(valid.difference(&file) <= TOLERANCE);
}

#[derive(Module, Debug)]
struct ConvNorm {
    conv: Conv2d,
    norm: BatchNorm,
}

/// Batch norms that are left after ONNX Runtime's optimisations.
fn left_unfolded(file: &[u8], name: &str) -> bool {
    let path = std::env::temp_dir().join(format!("onnx-parity-{name}-{}.onnx", std::process::id()));
    runtime::optimise(file, &path);
    let optimised = std::fs::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    let has = |op: &[u8]| optimised.windows(op.len()).any(|bytes| bytes == op);
    assert!(has(b"Conv"));
    has(b"BatchNormalization")
}

#[test]
fn onnx_runtime_folds_a_batch_norm_into_its_convolution() {
    let device = Device::flex();
    let module = ConvNorm { conv: Conv2dConfig::new([6, 6], [3, 3]).init(&device), norm: batch(1e-5) };
    let case = case(module, |module, x| module.norm.forward(module.conv.forward(x)));
    case.agrees();
    assert!(!left_unfolded(&case.export(), "fold"));
}

/// A size that only the convolution's successors know is asked of one whose shape costs no fusion.
#[test]
fn asking_for_a_size_does_not_hinder_the_folding() {
    let device = Device::flex();
    let module =
        ConvNorm { conv: Conv2dConfig::new([6, 6], [3, 3]).with_stride([2, 2]).init(&device), norm: batch(1e-5) };
    let forward = |module: &ConvNorm, x: Tensor<4>| {
        let half = relu(module.norm.forward(module.conv.forward(x.clone())));
        let again = module.conv.forward(x);
        let [b, c, h, w] = half.dims();
        half.clone().mean_dim(3).expand([b, c, h, w]) + half + module.norm.forward(again)
    };
    let case = case(module, forward);
    case.agrees();
    let file = case.export();
    assert!(count(&file, "Shape") > 0 && !left_unfolded(&file, "size"));
}

/// The tolerance of these tests is fine enough: it tells ε = 1e-5 from 1.2e-5.
#[test]
fn a_wrong_epsilon_is_seen() {
    let forward = |norm: &InstanceNorm, x: Tensor<4>| norm.forward(x);
    let file = case(instance(1e-5), forward).export();
    assert!(case(instance(1e-5), forward).difference(&file) <= TOLERANCE);
    assert!(case(instance(1.2e-5), forward).difference(&file) > 10.0 * TOLERANCE);
    let forward = |norm: &BatchNorm, x: Tensor<4>| norm.forward(x);
    let file = case(batch(1e-5), forward).export();
    assert!(case(batch(1e-5), forward).difference(&file) <= TOLERANCE);
    assert!(case(batch(1e-3), forward).difference(&file) > 10.0 * TOLERANCE);
}

/// Scale and offset, or mean and variance, swapped: both are vectors of one length, and a swap must not pass.
#[test]
fn swapped_parameters_are_seen() {
    let forward = |norm: &BatchNorm, x: Tensor<4>| norm.forward(x);
    let file = case(batch(1e-5), forward).export();
    let mut swapped = case(batch(1e-5), forward);
    std::mem::swap(&mut swapped.module.gamma, &mut swapped.module.beta);
    assert!(swapped.difference(&file) > 100.0 * TOLERANCE);
    let mut swapped = case(batch(1e-5), forward);
    std::mem::swap(&mut swapped.module.running_mean, &mut swapped.module.running_var);
    assert!(swapped.difference(&file) > 100.0 * TOLERANCE);
}
