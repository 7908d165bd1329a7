extern crate alloc;
use burn::prelude::*;
use burn::nn::BatchNorm;
use burn::nn::BatchNormConfig;
use burn::nn::InstanceNorm;
use burn::nn::InstanceNormConfig;
use burn::nn::PaddingConfig2d;
use burn::nn::conv::Conv2d;
use burn::nn::conv::Conv2dConfig;
use burn::nn::conv::ConvTranspose2d;
use burn::nn::conv::ConvTranspose2dConfig;
use burn::tensor::Bytes;
use burn_store::BurnpackStore;
use burn_store::ModuleSnapshot;


#[derive(Module, Debug)]
pub struct Model {
    constant1: burn::module::Param<Tensor<2>>,
    constant28: burn::module::Param<Tensor<1>>,
    constant40: burn::module::Param<Tensor<1>>,
    constant41: burn::module::Param<Tensor<1>>,
    constant43: burn::module::Param<Tensor<1>>,
    constant46: burn::module::Param<Tensor<1>>,
    constant47: burn::module::Param<Tensor<1>>,
    constant49: burn::module::Param<Tensor<1>>,
    constant51: burn::module::Param<Tensor<1>>,
    conv2d1: Conv2d,
    batchnormalization1: BatchNorm,
    conv2d2: Conv2d,
    instancenormalization1: InstanceNorm,
    conv2d3: Conv2d,
    instancenormalization2: InstanceNorm,
    reshape5: burn::module::Param<Tensor<4>>,
    reshape6: burn::module::Param<Tensor<4>>,
    convtranspose2d1: ConvTranspose2d,
    resize1: burn::nn::interpolate::Interpolate2d,
    conv2d4: Conv2d,
    #[module(skip)]
    device: Device,
}


impl Model {
    /// Load model weights from in-memory bytes.
    ///
    /// The bytes must be the contents of a `.bpk` file.
    pub fn from_bytes(bytes: Bytes, device: &Device) -> Self {
        let mut model = Self::new(device);
        let mut store = BurnpackStore::from_bytes(Some(bytes));
        model
            .load_from(&mut store)
            .unwrap_or_else(|e| panic!("Failed to load burnpack bytes: {e}"));
        model
    }
}

impl Model {
    #[allow(unused_variables)]
    pub fn new(device: &Device) -> Self {
        let constant1: burn::module::Param<Tensor<2>> = burn::module::Param::uninitialized(
            burn::module::ParamId::new(),
            move |device, _require_grad| Tensor::<
                2,
            >::zeros([5, 2], (device, burn::tensor::DType::F32)),
            device.clone(),
            false,
            [5, 2].into(),
        );
        let constant28: burn::module::Param<Tensor<1>> = burn::module::Param::uninitialized(
            burn::module::ParamId::new(),
            move |device, _require_grad| Tensor::<
                1,
            >::from_data(
                burn::tensor::TensorData::from([50f64]),
                (device, burn::tensor::DType::F32),
            ),
            device.clone(),
            false,
            [1].into(),
        );
        let constant40: burn::module::Param<Tensor<1>> = burn::module::Param::uninitialized(
            burn::module::ParamId::new(),
            move |device, _require_grad| Tensor::<
                1,
            >::from_data(
                burn::tensor::TensorData::from([-0.019999999552965164f64]),
                (device, burn::tensor::DType::F32),
            ),
            device.clone(),
            false,
            [1].into(),
        );
        let constant41: burn::module::Param<Tensor<1>> = burn::module::Param::uninitialized(
            burn::module::ParamId::new(),
            move |device, _require_grad| Tensor::<
                1,
            >::from_data(
                burn::tensor::TensorData::from([1f64]),
                (device, burn::tensor::DType::F32),
            ),
            device.clone(),
            false,
            [1].into(),
        );
        let constant43: burn::module::Param<Tensor<1>> = burn::module::Param::uninitialized(
            burn::module::ParamId::new(),
            move |device, _require_grad| Tensor::<
                1,
            >::from_data(
                burn::tensor::TensorData::from([255f64]),
                (device, burn::tensor::DType::F32),
            ),
            device.clone(),
            false,
            [1].into(),
        );
        let constant46: burn::module::Param<Tensor<1>> = burn::module::Param::uninitialized(
            burn::module::ParamId::new(),
            move |device, _require_grad| Tensor::<
                1,
            >::from_data(
                burn::tensor::TensorData::from([0.10000000149011612f64]),
                (device, burn::tensor::DType::F32),
            ),
            device.clone(),
            false,
            [1].into(),
        );
        let constant47: burn::module::Param<Tensor<1>> = burn::module::Param::uninitialized(
            burn::module::ParamId::new(),
            move |device, _require_grad| Tensor::<
                1,
            >::from_data(
                burn::tensor::TensorData::from([0.5f64]),
                (device, burn::tensor::DType::F32),
            ),
            device.clone(),
            false,
            [1].into(),
        );
        let constant49: burn::module::Param<Tensor<1>> = burn::module::Param::uninitialized(
            burn::module::ParamId::new(),
            move |device, _require_grad| Tensor::<
                1,
            >::from_data(
                burn::tensor::TensorData::from([0.009999999776482582f64]),
                (device, burn::tensor::DType::F32),
            ),
            device.clone(),
            false,
            [1].into(),
        );
        let constant51: burn::module::Param<Tensor<1>> = burn::module::Param::uninitialized(
            burn::module::ParamId::new(),
            move |device, _require_grad| Tensor::<
                1,
            >::from_data(
                burn::tensor::TensorData::from([1000f64]),
                (device, burn::tensor::DType::F32),
            ),
            device.clone(),
            false,
            [1].into(),
        );
        let conv2d1 = Conv2dConfig::new([4, 8], [3, 3])
            .with_stride([1, 1])
            .with_padding(PaddingConfig2d::Valid)
            .with_dilation([1, 1])
            .with_groups(1)
            .with_bias(true)
            .init(device);
        let batchnormalization1 = BatchNormConfig::new(8)
            .with_epsilon(0.000009999999747378752f64)
            .with_momentum(0f64)
            .init(device);
        let conv2d2 = Conv2dConfig::new([8, 8], [3, 3])
            .with_stride([2, 2])
            .with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1))
            .with_dilation([1, 1])
            .with_groups(1)
            .with_bias(true)
            .init(device);
        let instancenormalization1 = InstanceNormConfig::new(8)
            .with_epsilon(0.000009999999747378752f64)
            .init(device);
        let conv2d3 = Conv2dConfig::new([8, 8], [1, 1])
            .with_stride([1, 1])
            .with_padding(PaddingConfig2d::Valid)
            .with_dilation([1, 1])
            .with_groups(1)
            .with_bias(true)
            .init(device);
        let instancenormalization2 = InstanceNormConfig::new(2)
            .with_epsilon(0.000009999999747378752f64)
            .init(device);
        let reshape5: burn::module::Param<Tensor<4>> = burn::module::Param::uninitialized(
            burn::module::ParamId::new(),
            move |device, _require_grad| Tensor::<
                4,
            >::zeros([1, 8, 1, 1], (device, burn::tensor::DType::F32)),
            device.clone(),
            false,
            [1, 8, 1, 1].into(),
        );
        let reshape6: burn::module::Param<Tensor<4>> = burn::module::Param::uninitialized(
            burn::module::ParamId::new(),
            move |device, _require_grad| Tensor::<
                4,
            >::zeros([1, 8, 1, 1], (device, burn::tensor::DType::F32)),
            device.clone(),
            false,
            [1, 8, 1, 1].into(),
        );
        let convtranspose2d1 = ConvTranspose2dConfig::new([8, 8], [4, 4])
            .with_stride([2, 2])
            .with_padding([1, 1])
            .with_padding_out([0, 0])
            .with_dilation([1, 1])
            .with_groups(1)
            .with_bias(true)
            .init(device);
        let resize1 = burn::nn::interpolate::Interpolate2dConfig::new()
            .with_output_size(None)
            .with_scale_factor(Some([2.0, 2.0]))
            .with_mode(burn::nn::interpolate::InterpolateMode::Nearest)
            .with_align_corners(false)
            .init();
        let conv2d4 = Conv2dConfig::new([16, 2], [1, 1])
            .with_stride([1, 1])
            .with_padding(PaddingConfig2d::Valid)
            .with_dilation([1, 1])
            .with_groups(1)
            .with_bias(true)
            .init(device);
        Self {
            constant1,
            constant28,
            constant40,
            constant41,
            constant43,
            constant46,
            constant47,
            constant49,
            constant51,
            conv2d1,
            batchnormalization1,
            conv2d2,
            instancenormalization1,
            conv2d3,
            instancenormalization2,
            reshape5,
            reshape6,
            convtranspose2d1,
            resize1,
            conv2d4,
            device: device.clone(),
        }
    }

    #[allow(clippy::let_and_return, clippy::approx_constant)]
    pub fn forward(&self, scan: Tensor<4>, noise: Tensor<4>) -> (Tensor<4>, Tensor<4>) {
        let constant1_out1 = self.constant1.val();
        let constant28_out1 = self.constant28.val();
        let constant40_out1 = self.constant40.val();
        let constant41_out1 = self.constant41.val();
        let constant43_out1 = self.constant43.val();
        let constant44_out1 = 2f32;
        let constant46_out1 = self.constant46.val();
        let constant47_out1 = self.constant47.val();
        let constant48_out1 = 0f32;
        let constant49_out1 = self.constant49.val();
        let constant51_out1 = self.constant51.val();
        let shape1_out1: [i64; 1] = {
            let axes = &scan.clone().dims()[3..4];
            let mut output = [0i64; 1];
            for i in 0..1 {
                output[i] = axes[i] as i64;
            }
            output
        };
        let squeeze1_out1 = shape1_out1[0] as i64;
        let range1_out1 = {
            let start = 0i64;
            let delta = 1i64;
            assert!(delta != 0);
            let n = (((squeeze1_out1 as i128 - start as i128) as f64) / delta as f64)
                .ceil()
                .max(0.0) as i64;
            Tensor::arange(0..n, &self.device)
                .cast(burn::tensor::DType::I64)
                .mul_scalar(delta)
                .add_scalar(start)
        };
        let slice1_out1 = scan.clone().slice(s![.., 0..1, .., ..]);
        let slice2_out1 = scan.clone().slice(s![.., 1..2, .., ..]);
        let slice3_out1 = scan.slice(s![.., 2..3, .., ..]);
        let cast2_out1 = slice3_out1.int().cast(burn::tensor::DType::I64);
        let reshape1_out1 = cast2_out1.reshape([0, -1]);
        let gather1_out1 = {
            let axis_size = constant1_out1.dims()[0] as i64;
            let negative = reshape1_out1.clone().lower_elem(0i64);
            let corrected = reshape1_out1.clone() + axis_size;
            let indices = reshape1_out1.mask_where(negative, corrected);
            constant1_out1.take::<2, 3>(0, indices)
        };
        let transpose1_out1 = gather1_out1.permute([0, 2, 1]);
        let reshape2_out1 = transpose1_out1.reshape([0, 2, 8, -1]);
        let div1_out1 = slice1_out1
            .clone()
            .div((constant28_out1).unsqueeze_dims(&[0isize, 1isize, 2isize]));
        let concat1_out1 = burn::tensor::Tensor::cat(
            [div1_out1, slice2_out1.clone(), reshape2_out1].into(),
            1,
        );
        let slice4_out1 = concat1_out1.clone().slice(s![.., .., .., - 1..]);
        let slice5_out1 = concat1_out1.clone().slice(s![.., .., .., 0..1]);
        let concat2_out1 = burn::tensor::Tensor::cat(
            [slice4_out1, concat1_out1, slice5_out1].into(),
            3,
        );
        let slice6_out1 = concat2_out1.clone().slice(s![.., .., 1..2, ..]);
        let slice7_out1 = {
            let slice_input = slice6_out1;
            let slice_dims = slice_input.dims();
            let reverse_bounds = |
                dim: usize,
                start: i64,
                end: i64,
            | -> core::ops::Range<usize> {
                if dim == 0 {
                    return 0..0;
                }
                let dim = dim as i64;
                let start = if start < 0 { start.saturating_add(dim) } else { start };
                let end = if end < 0 { end.saturating_add(dim) } else { end };
                let hi = start.clamp(-1, dim - 1) + 1;
                let lo = (end.clamp(-1, dim - 1) + 1).min(hi);
                (lo as usize)..(hi as usize)
            };
            slice_input
                .slice(
                    s![.., .., reverse_bounds(slice_dims[2], - 1i64, i64::MIN); - 1, ..],
                )
        };
        let slice8_out1 = concat2_out1.clone().slice(s![.., .., 6..7, ..]);
        let concat3_out1 = burn::tensor::Tensor::cat(
            [slice7_out1, concat2_out1, slice8_out1].into(),
            2,
        );
        let conv2d1_out1 = self.conv2d1.forward(concat3_out1);
        let batchnormalization1_out1 = self.batchnormalization1.forward(conv2d1_out1);
        let relu1_out1 = burn::tensor::activation::relu(batchnormalization1_out1);
        let conv2d2_out1 = self.conv2d2.forward(relu1_out1.clone());
        let instancenormalization1_out1 = self
            .instancenormalization1
            .forward(conv2d2_out1);
        let leakyrelu1_out1 = burn::tensor::activation::leaky_relu(
            instancenormalization1_out1,
            0.20000000298023224,
        );
        let conv2d3_out1 = self.conv2d3.forward(leakyrelu1_out1.clone());
        let reshape3_out1 = conv2d3_out1.reshape([0, 2, -1]);
        let instancenormalization2_out1 = self
            .instancenormalization2
            .forward(reshape3_out1);
        let reshape4_out1 = instancenormalization2_out1.reshape([0, 8, 4, -1]);
        let reshape5_out1 = self.reshape5.val();
        let mul1_out1 = reshape4_out1.mul(reshape5_out1);
        let reshape6_out1 = self.reshape6.val();
        let add1_out1 = mul1_out1.add(reshape6_out1);
        let add2_out1 = leakyrelu1_out1.clone().add(add1_out1);
        let convtranspose2d1_out1 = self.convtranspose2d1.forward(add2_out1);
        let relu2_out1 = burn::tensor::activation::relu(convtranspose2d1_out1);
        let resize1_out1 = self.resize1.forward(leakyrelu1_out1);
        let add3_out1 = relu2_out1.add(resize1_out1);
        let concat4_out1 = burn::tensor::Tensor::cat([add3_out1, relu1_out1].into(), 1);
        let conv2d4_out1 = self.conv2d4.forward(concat4_out1);
        let slice9_out1 = conv2d4_out1.clone().slice(s![.., 0..1, .., ..]);
        let tanh1_out1 = slice9_out1.tanh();
        let mul2_out1 = tanh1_out1.mul(noise.clone());
        let add4_out1 = slice1_out1.add(mul2_out1);
        let slice10_out1 = conv2d4_out1.slice(s![.., 1..2, .., ..]);
        let sigmoid1_out1 = burn::tensor::activation::sigmoid(slice10_out1);
        let mul3_out1 = add4_out1
            .clone()
            .mul((constant40_out1).unsqueeze_dims(&[0isize, 1isize, 2isize]));
        let exp1_out1 = mul3_out1.exp();
        let mul4_out1 = slice2_out1.mul(exp1_out1);
        let max1_out1 = add4_out1
            .clone()
            .max_pair(
                (constant41_out1.clone()).unsqueeze_dims(&[0isize, 1isize, 2isize]),
            );
        let mul5_out1 = max1_out1.clone().mul(max1_out1);
        let reciprocal1_out1 = mul5_out1.recip();
        let mul6_out1 = mul4_out1.mul(reciprocal1_out1);
        let clip1_out1 = mul6_out1.clamp(0.0000009999999974752427f64, 1f64);
        let mul7_out1 = clip1_out1
            .mul((constant43_out1).unsqueeze_dims(&[0isize, 1isize, 2isize]));
        let add5_out1 = mul7_out1
            .add((constant41_out1).unsqueeze_dims(&[0isize, 1isize, 2isize]));
        let log1_out1 = add5_out1.log();
        let less1_out1 = noise.clone().lower(sigmoid1_out1.clone());
        let greater1_out1 = add4_out1.clone().greater_elem(constant44_out1);
        let and1_out1 = less1_out1.bool_and(greater1_out1);
        let not1_out1 = and1_out1.bool_not();
        let cast3_out1 = range1_out1.float().cast(burn::tensor::DType::F32);
        let reshape7_out1 = cast3_out1.reshape([1, 1, 1, -1]);
        let mul8_out1 = reshape7_out1
            .mul((constant46_out1).unsqueeze_dims(&[0isize, 1isize, 2isize]));
        let sin1_out1 = mul8_out1.sin();
        let add6_out1 = noise
            .add((constant47_out1).unsqueeze_dims(&[0isize, 1isize, 2isize]));
        let sqrt1_out1 = add6_out1.sqrt();
        let add7_out1 = sin1_out1.add(sqrt1_out1);
        let abs1_out1 = add7_out1.abs();
        let reducemean1_out1 = { add4_out1.clone().mean_dim(3usize) };
        let equal1_out1 = add4_out1.clone().equal_elem(constant48_out1);
        let mul9_out1 = abs1_out1
            .mul((constant49_out1).unsqueeze_dims(&[0isize, 1isize, 2isize]));
        let add8_out1 = mul9_out1.add(reducemean1_out1);
        let where1_out1 = add4_out1.clone().mask_where(equal1_out1, add8_out1);
        let cumsum1_out1 = add4_out1.cumsum(3);
        let div2_out1 = cumsum1_out1
            .div((constant51_out1).unsqueeze_dims(&[0isize, 1isize, 2isize]));
        let add9_out1 = where1_out1.add(div2_out1);
        let where2_out1 = add9_out1.mask_fill(not1_out1, constant48_out1);
        let mul10_out1 = sigmoid1_out1.mul(log1_out1);
        (where2_out1, mul10_out1)
    }
}
