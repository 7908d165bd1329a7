//! Random numbers for inputs and parameters, the same in every run.

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Bool, Device, Int, Tensor, TensorData};

/// A module without parameters, for functions of tensors.
#[derive(Module, Debug)]
pub(crate) struct Function {}

/// `SplitMix64` (Steele, Lea and Flood 2014): one well-mixed number per state.
pub(crate) struct Numbers(u64);

impl Numbers {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in `[low, high)`.
    pub(crate) fn between(&mut self, low: f32, high: f32) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        let unit = ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32;
        low + (high - low) * unit
    }
}

/// Floats in `[low, high)`.
pub(crate) fn floats_between<const D: usize>(shape: [usize; D], seed: u64, low: f32, high: f32) -> Tensor<D> {
    let mut numbers = Numbers::new(seed);
    let values: Vec<f32> = (0..shape.iter().product()).map(|_| numbers.between(low, high)).collect();
    Tensor::from_data(TensorData::new(values, shape), &Device::flex())
}

/// Floats in `[-2, 2)`.
pub(crate) fn floats<const D: usize>(shape: [usize; D], seed: u64) -> Tensor<D> {
    floats_between(shape, seed, -2.0, 2.0)
}

/// Integers in `[0, end)`.
pub(crate) fn integers<const D: usize>(shape: [usize; D], seed: u64, end: usize) -> Tensor<D, Int> {
    let mut numbers = Numbers::new(seed);
    let values: Vec<i64> = (0..shape.iter().product()).map(|_| numbers.between(0.0, end as f32) as i64).collect();
    Tensor::from_data(TensorData::new(values, shape), &Device::flex())
}

/// Truth values, about half of them true.
pub(crate) fn truths<const D: usize>(shape: [usize; D], seed: u64) -> Tensor<D, Bool> {
    floats(shape, seed).greater_elem(0.0)
}

/// The module with random parameters, norms and running statistics included, so that a mix-up of two shows.
pub(crate) fn scrambled<M: Module>(module: M, seed: u64) -> M {
    module.map(&mut Scramble { numbers: Numbers::new(seed), path: Vec::new() })
}

struct Scramble {
    numbers: Numbers,
    path: Vec<String>,
}

impl ModuleMapper for Scramble {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        // A variance is positive; a scale near zero would hide what it scales.
        let (low, high) = match self.path.last().map(String::as_str) {
            Some("running_var" | "gamma") => (0.5, 1.5),
            _ => (-0.5, 0.5),
        };
        param.map(|tensor| {
            let values: Vec<f32> =
                (0..tensor.shape().num_elements()).map(|_| self.numbers.between(low, high)).collect();
            Tensor::from_data(TensorData::new(values, tensor.shape()), &tensor.device())
        })
    }
}
