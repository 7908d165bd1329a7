//! A trained generator as it goes out: physical units in, physical units out.

use burn::module::Module;
use burn::tensor::Tensor;
use burn::tensor::activation::sigmoid;

use super::answer::Reporting;
use crate::generator::Generator;
use crate::network::{Measurement, Resnet};

/// A generator between the codes of its inputs and outputs.
///
/// It draws nothing: which rays are reported is drawn outside, by its `keep`, which comes to the same as the Gumbel-sigmoid of training.
#[derive(Module, Debug)]
pub struct Translator {
    generator: Resnet,
    #[module(skip)]
    reporting: Reporting,
}

impl Translator {
    /// A generator for whole turns, whose answers lose rays as in training.
    pub fn new(generator: Resnet, reporting: Reporting) -> Self {
        Self { generator, reporting }
    }

    /// The network between the codes.
    pub fn generator(&self) -> &Resnet {
        &self.generator
    }
}

impl Generator for Translator {
    fn measure(&self, scan: Tensor<4>) -> Measurement {
        let Reporting { coding, ray_drop } = self.reporting;
        let view = coding.view(&scan);
        let generated = self.generator.forward(view.image, &view.condition);
        let keep = if ray_drop { sigmoid(generated.keep_logit) } else { coding.shows_return(&generated.image) };
        // The code of reflectances, −1 to 1, is twice as wide as they are.
        let scatter = generated.scatter.as_ref().map(|scatter| scatter.clone() / 2.0 * view.returned.clone());
        let image = &generated.image;
        Measurement {
            range_m: coding.range_m(image) * view.returned.clone(),
            reflectance: coding.reflectance(image) * view.returned.clone(),
            keep: keep * view.returned,
            scatter,
        }
    }
}
