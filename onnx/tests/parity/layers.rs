//! Convolutions, pooling, linear maps and embeddings.

use burn::module::{Module, Param, ParamId};
use burn::nn::conv::{
    Conv1d, Conv1dConfig, Conv2d, Conv2dConfig, Conv3d, Conv3dConfig, ConvTranspose1d, ConvTranspose1dConfig,
    ConvTranspose2d, ConvTranspose2dConfig, ConvTranspose3d, ConvTranspose3dConfig,
};
use burn::nn::pool::{
    AdaptiveAvgPool1dConfig, AdaptiveAvgPool2d, AdaptiveAvgPool2dConfig, AvgPool1dConfig, AvgPool2d, AvgPool2dConfig,
    MaxPool1dConfig, MaxPool2d, MaxPool2dConfig,
};
use burn::nn::{
    Embedding, EmbeddingConfig, Linear, LinearConfig, PRelu, PReluConfig, PaddingConfig1d, PaddingConfig2d,
};
use burn::tensor::module::adaptive_avg_pool3d;
use burn::tensor::{Device, Int, Tensor, s};

use crate::comparison::{At, Case, Readable, function_agrees, image};
use crate::norms::count;
use crate::sample::{floats, floats_between, scrambled};

/// Asserts that a layer over `[batch, 3, 8, column]` agrees.
fn layer_agrees<M: Module, O: Readable>(layer: M, multiple: usize, forward: impl Fn(&M, Tensor<4>) -> O) {
    let inputs = |at: At| floats([at.batch, 3, 8, at.column], 1);
    Case { module: scrambled(layer, 5), inputs, forward, multiple }.agrees();
}

fn conv(config: &Conv2dConfig, multiple: usize) {
    layer_agrees(config.init(&Device::flex()), multiple, |conv: &Conv2d, x| conv.forward(x));
}

#[test]
fn convolutions_of_every_geometry() {
    let config = || Conv2dConfig::new([3, 6], [3, 3]);
    conv(&config(), 1);
    conv(&config().with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1)), 1);
    conv(&config().with_padding(PaddingConfig2d::Explicit(1, 0, 2, 1)), 1);
    conv(&config().with_padding(PaddingConfig2d::Same), 1);
    conv(&config().with_stride([2, 2]).with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1)), 1);
    conv(&config().with_stride([1, 4]).with_bias(false), 4);
    conv(&config().with_dilation([2, 1]).with_groups(3), 1);
}

#[test]
fn convolutions_along_one_axis() {
    let config = Conv1dConfig::new(3, 6, 3).with_padding(PaddingConfig1d::Explicit(2, 1));
    let module = scrambled(config.init(&Device::flex()), 5);
    let inputs = |at: At| floats([at.batch, 3, at.column], 1);
    Case { module, inputs, forward: |conv: &Conv1d, x: Tensor<3>| conv.forward(x), multiple: 1 }.agrees();
}

#[test]
fn convolutions_in_three_dimensions() {
    let inputs = |at: At| floats([at.batch, 2, 4, 3, at.column], 1);
    let module = scrambled(Conv3dConfig::new([2, 3], [3, 2, 3]).with_stride([1, 1, 2]).init(&Device::flex()), 5);
    Case { module, inputs, forward: |conv: &Conv3d, x: Tensor<5>| conv.forward(x), multiple: 1 }.agrees();
    let module =
        scrambled(ConvTranspose3dConfig::new([2, 3], [3, 2, 3]).with_stride([1, 1, 2]).init(&Device::flex()), 5);
    Case { module, inputs, forward: |conv: &ConvTranspose3d, x: Tensor<5>| conv.forward(x), multiple: 1 }.agrees();
}

#[test]
fn transposed_convolutions_along_one_axis() {
    let inputs = |at: At| floats([at.batch, 3, at.column], 1);
    let module =
        scrambled(ConvTranspose1dConfig::new([3, 6], 4).with_stride(2).with_padding(1).init(&Device::flex()), 5);
    Case { module, inputs, forward: |conv: &ConvTranspose1d, x: Tensor<3>| conv.forward(x), multiple: 1 }.agrees();
}

#[test]
fn transposed_convolutions_of_every_geometry() {
    let config = || ConvTranspose2dConfig::new([3, 6], [3, 3]);
    let check = |config: ConvTranspose2dConfig| {
        layer_agrees(config.init(&Device::flex()), 1, |conv: &ConvTranspose2d, x| conv.forward(x));
    };
    check(config());
    check(config().with_stride([2, 2]).with_padding([1, 1]).with_padding_out([1, 1]));
    check(config().with_stride([1, 3]).with_padding([0, 2]).with_dilation([2, 1]).with_bias(false));
    check(ConvTranspose2dConfig::new([3, 6], [4, 4]).with_stride([2, 2]).with_padding([1, 1]).with_groups(3));
}

#[test]
fn pooling() {
    layer_agrees(MaxPool2dConfig::new([2, 2]).with_strides([2, 2]).init(), 1, MaxPool2d::forward);
    let padded = MaxPool2dConfig::new([3, 3]).with_strides([2, 2]).with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1));
    layer_agrees(padded.init(), 1, MaxPool2d::forward);
    layer_agrees(MaxPool2dConfig::new([2, 2]).with_strides([1, 1]).with_dilation([2, 1]).init(), 1, |pool, x| {
        pool.forward(x)
    });
    layer_agrees(AvgPool2dConfig::new([2, 2]).with_strides([2, 2]).init(), 1, AvgPool2d::forward);
    for count in [false, true] {
        let padded =
            AvgPool2dConfig::new([3, 3]).with_strides([2, 2]).with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1));
        layer_agrees(padded.with_count_include_pad(count).init(), 1, AvgPool2d::forward);
    }
    layer_agrees(AdaptiveAvgPool2dConfig::new([1, 1]).init(), 1, AdaptiveAvgPool2d::forward);
}

/// The last window may hang over the edge.
#[test]
fn pooling_rounded_up() {
    let largest = MaxPool2dConfig::new([3, 3]).with_strides([2, 2]).with_ceil_mode(true);
    layer_agrees(largest.init(), 1, MaxPool2d::forward);
    let mean = AvgPool2dConfig::new([3, 3]).with_strides([2, 2]).with_ceil_mode(true);
    layer_agrees(mean.init(), 2, AvgPool2d::forward);
}

#[test]
fn pooling_along_one_axis() {
    let rows = |at: At| floats([at.batch, 3, at.column], 1);
    let (largest, mean) =
        (MaxPool1dConfig::new(2).with_stride(2).init(), AvgPool1dConfig::new(3).with_stride(1).init());
    let global = AdaptiveAvgPool1dConfig::new(1).init();
    function_agrees(rows, |x: Tensor<3>| (largest.forward(x.clone()), mean.forward(x.clone()), global.forward(x)));
}

#[test]
fn adaptive_pooling_of_a_fixed_size() {
    function_agrees(|at: At| floats([at.batch, 3, 4, 8, 9], 1), |x: Tensor<5>| adaptive_avg_pool3d(x, [2, 2, 3]));
    let pool = AdaptiveAvgPool2dConfig::new([2, 3]).init();
    function_agrees(|at: At| floats([at.batch, 3, 8, 9], 1), |x: Tensor<4>| pool.forward(x));
}

/// Burn folds 40 columns into its rows, but not 32, which fill a tile: the traces see both, the file must not.
#[test]
fn linear_maps_agree_whether_burn_folds_their_rows_or_not() {
    for bias in [true, false] {
        let module: Linear = scrambled(LinearConfig::new(6, 5).with_bias(bias).init(&Device::flex()), 5);
        let inputs = |at: At| floats([at.batch, at.column, 6], 1);
        let case = Case { module, inputs, forward: |linear: &Linear, x: Tensor<3>| linear.forward(x), multiple: 8 };
        case.agrees();
        let file = case.export();
        assert_eq!((count(&file, "MatMul"), count(&file, "Add"), count(&file, "Reshape")), (1, usize::from(bias), 0));
    }
}

#[test]
fn linear_maps_of_every_rank() {
    let device = Device::flex();
    let module: Linear = scrambled(LinearConfig::new(6, 5).init(&device), 5);
    let forward = |linear: &Linear, (a, b, c): (Tensor<1>, Tensor<2>, Tensor<4>)| {
        (linear.forward(a), linear.forward(b), linear.forward(c))
    };
    let inputs = |at: At| (floats([6], 1), floats([at.column, 6], 2), floats([at.batch, 2, at.column, 6], 3));
    Case { module, inputs, forward, multiple: 8 }.agrees();
}

#[derive(Module, Debug)]
struct Product {
    weight: Param<Tensor<2>>,
    bias: Param<Tensor<1>>,
}

/// The steps of a linear map, taken by hand and read twice, are not one layer.
#[test]
fn a_product_that_is_read_twice_stays() {
    let weight = floats::<2>([6, 5], 2);
    let module = Product { weight: Param::from_tensor(weight), bias: Param::from_tensor(floats([5], 3)) };
    let forward = |product: &Product, x: Tensor<3>| {
        let [b, w, _] = x.dims();
        let rows = x.reshape([b * w, 6]).matmul(product.weight.val());
        let sum = rows.clone() + product.bias.val().reshape([1, 5]);
        (sum.reshape([b, w, 5]), rows)
    };
    Case { module, inputs: |at: At| floats([at.batch, at.column, 6], 1), forward, multiple: 4 }.agrees();
}

/// A class index arrives as a float channel and selects a learned vector.
#[test]
fn an_embedding_looks_up_a_class() {
    let module: Embedding = scrambled(EmbeddingConfig::new(20, 4).init(&Device::flex()), 5);
    let inputs = |at: At| floats_between([at.batch, 1, 4, at.column], 3, 0.0, 20.0).floor();
    let forward = |embedding: &Embedding, class: Tensor<4>| {
        let [b, _, h, w] = class.dims();
        let vectors = embedding.forward(class.int().reshape([b, h * w]));
        vectors.swap_dims(1, 2).reshape([b, 4, h, w])
    };
    Case { module, inputs, forward, multiple: 1 }.agrees();
}

#[test]
fn parametric_relu() {
    let module: PRelu = scrambled(PReluConfig::new().with_num_parameters(3).init(&Device::flex()), 5);
    Case { module, inputs: image, forward: |prelu: &PRelu, x: Tensor<4>| prelu.forward(x), multiple: 1 }.agrees();
}

/// A table of integers in the module meets integers that the forward pass makes.
#[test]
fn integer_parameters_mix_with_integers_made_on_the_way() {
    #[derive(Module, Debug)]
    struct Rings {
        order: Param<Tensor<1, Int>>,
    }
    let module = Rings { order: Param::initialized(ParamId::new(), Tensor::from_ints([3, 1, 0, 2], &Device::flex())) };
    let forward = |rings: &Rings, x: Tensor<4>| {
        let first = x.clone().clamp(0.0, 3.0).int().slice(s![.., 0..1, .., ..]);
        (x.select(2, rings.order.val()), first + rings.order.val().reshape([1, 1, 4, 1]))
    };
    Case { module, inputs: image, forward, multiple: 1 }.agrees();
}
