//! A turn of more columns than a network has learned to see, read as several turns.

use burn::module::Module;
use burn::tensor::Tensor;

use super::Generator;
use crate::network::Measurement;

/// A network that sees every n-th column of a turn as a scan of its own, from each of the first n columns on: what it sees is as coarse as
/// what it learned from, and every ray is answered.
#[derive(Module, Debug)]
pub struct Phased<M: Module> {
    network: M,
    phases: usize,
}

impl<M: Module> Phased<M> {
    /// A network for turns of `phases` times the columns that it learned from.
    pub fn new(network: M, phases: usize) -> Self {
        Self { network, phases }
    }
}

impl<M: Generator + Module> Generator for Phased<M> {
    /// The number of columns is a multiple of the number of phases.
    fn measure(&self, scan: Tensor<4>) -> Measurement {
        let [batch, channels, rings, columns] = scan.dims();
        let (phases, seen) = (self.phases, columns / self.phases);
        let apart = scan.reshape([batch, channels, rings, seen, phases]).permute([0, 4, 1, 2, 3]);
        let measured = self.network.measure(apart.reshape([batch * phases, channels, rings, seen]));
        let together = |x: Tensor<4>| {
            x.reshape([batch, phases, 1, rings, seen]).permute([0, 2, 3, 4, 1]).reshape([batch, 1, rings, columns])
        };
        Measurement {
            range_m: together(measured.range_m),
            reflectance: together(measured.reflectance),
            keep: together(measured.keep),
            scatter: measured.scatter.map(together),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Distribution, s};

    /// Says of each ray what its right neighbour's reflectance is.
    #[derive(Module, Debug)]
    struct Neighbour {}

    impl Generator for Neighbour {
        fn measure(&self, scan: Tensor<4>) -> Measurement {
            let channel = |i: usize| scan.clone().slice(s![.., i..=i]);
            let turned = channel(1);
            let reflectance =
                Tensor::cat(vec![turned.clone().slice(s![.., .., .., 1..]), turned.slice(s![.., .., .., 0..1])], 3);
            Measurement { range_m: channel(0), reflectance, keep: channel(0) * 0.0 + 1.0, scatter: None }
        }
    }

    #[test]
    fn each_phase_is_a_turn_of_its_own_and_every_ray_is_answered_in_its_place() {
        let device = Device::flex();
        device.seed(2);
        let scan = Tensor::<4>::random([2, 3, 4, 12], Distribution::Uniform(0.0, 1.0), &device);
        let measured = Phased::new(Neighbour {}, 3).measure(scan.clone());
        let values = |x: Tensor<4>| x.into_data().iter::<f32>().collect::<Vec<_>>();
        assert_eq!(values(measured.range_m), values(scan.clone().slice(s![.., 0..1])));
        // The neighbour in one's own phase is three columns on, and beyond the last column the first ones come.
        let reflectance = scan.slice(s![.., 1..2]);
        let expected = Tensor::cat(
            vec![reflectance.clone().slice(s![.., .., .., 3..]), reflectance.slice(s![.., .., .., 0..3])],
            3,
        );
        assert_eq!(values(measured.reflectance), values(expected));
    }
}
