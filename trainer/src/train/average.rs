//! The exponential moving average of a network's weights, norms' statistics included: smoother than any one step's network.

use std::collections::HashMap;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::tensor::Tensor;

/// Weights by their parameter, as a row of numbers.
#[derive(Default)]
struct Weights(HashMap<ParamId, Tensor<1>>);

/// Moves weights towards those of another network.
struct Mixer {
    towards: Weights,
    stays: f64,
}

/// The average, once `network`, of which it is a copy, has made its `step`-th step.
///
/// Of it `stays` remains a step, less while there are few steps, so that the random weights of the beginning are forgotten.
#[must_use]
pub fn averaged<M: Module>(average: M, network: &M, step: usize, stays: f64) -> M {
    let mut towards = Weights::default();
    network.valid().visit(&mut towards);
    let steps = step as f64;
    average.map(&mut Mixer { towards, stays: stays.min((1.0 + steps) / (10.0 + steps)) })
}

impl ModuleVisitor for Weights {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.0.insert(param.id, param.val().flatten(0, D - 1));
    }
}

impl ModuleMapper for Mixer {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(towards) = self.towards.0.remove(&param.id) else {
            return param;
        };
        let stays = self.stays;
        param.map(|average| {
            let towards = towards.reshape(average.dims());
            average.mul_scalar(stays) + towards.mul_scalar(1.0 - stays)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::nn::{Linear, LinearConfig};
    use burn::tensor::Device;

    fn first_weight(network: &Linear) -> f32 {
        network.weight.val().into_data().iter::<f32>().next().unwrap_or(f32::NAN)
    }

    struct Set(f32);

    impl ModuleMapper for Set {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            param.map(|x| x.zeros_like() + self.0)
        }
    }

    #[test]
    fn an_average_follows_slowly_once_there_are_many_steps() {
        let network = LinearConfig::new(3, 2).init(&Device::flex().autodiff()).map(&mut Set(1.0));
        let average = network.valid().map(&mut Set(0.0));
        assert!((first_weight(&averaged(average.clone(), &network, 1_000_000, 0.99)) - 0.01).abs() < 1e-6);
        // After the first step 2 of 11 stay.
        assert!((first_weight(&averaged(average, &network, 1, 0.99)) - 9.0 / 11.0).abs() < 1e-6);
    }
}
