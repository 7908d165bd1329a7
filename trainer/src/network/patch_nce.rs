//! The contrastive loss of patches: what a place of the answer shows should be more like the same place of the question than like any other
//! place of it. Park et al. (2020), equations 3 and 4; CLS2R's equations 8 and 9.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Int, Tensor, TensorData};
use rand::Rng;
use rand::seq::index::sample;

use super::layers::linear;

/// Numbers that a patch is described by.
const NUMBERS: usize = 256;

/// How sharply patches are told apart; the papers' τ.
const TEMPERATURE: f64 = 0.07;

/// The heads that describe patches by their features, one a layer.
#[derive(Module, Debug)]
pub struct PatchHeads {
    heads: Vec<Head>,
}

/// Linear, `ReLU`, linear; then the direction alone counts.
#[derive(Module, Debug)]
struct Head {
    first: Linear,
    second: Linear,
}

/// Which places of each layer are compared: numbers of pixels, row-major, the same for every image of a batch.
#[derive(Clone, Debug)]
pub struct Places(Vec<Vec<usize>>);

impl Places {
    /// `number` places of each layer, or all where there are no more.
    pub fn draw(features: &[Tensor<4>], number: usize, rng: &mut impl Rng) -> Self {
        let of = |layer: &Tensor<4>| {
            let [_, _, rings, columns] = layer.dims();
            sample(rng, rings * columns, number.min(rings * columns)).into_vec()
        };
        Self(features.iter().map(of).collect())
    }
}

impl PatchHeads {
    /// Heads with random weights for layers of so many channels; `gain` as for [`ResnetConfig`](super::ResnetConfig).
    pub fn new(channels: &[usize], gain: f64, device: &Device) -> Self {
        let layer = |from| linear(from, NUMBERS, gain, device);
        let head = |n: &usize| Head { first: layer(*n), second: layer(NUMBERS) };
        Self { heads: channels.iter().map(head).collect() }
    }

    /// The loss, averaged over layers, images and places, of the features of an `answer`, beside those of the `question` that it answers,
    /// which are what is aimed at: no gradient passes into them.
    pub fn loss(&self, answer: &[Tensor<4>], question: &[Tensor<4>], places: &Places) -> Tensor<1> {
        let of_layer = |(i, head): (usize, &Head)| {
            let answer = head.describe(&answer[i], &places.0[i]);
            let question = head.describe(&question[i], &places.0[i]).detach();
            contrast(answer, &question)
        };
        let layers = self.heads.len() as f64;
        let losses = self.heads.iter().enumerate().map(of_layer);
        losses.reduce(|a, b| a + b).unwrap_or_else(|| unreachable!("a network has layers")) / layers
    }
}

impl Head {
    /// Unit vectors, `[batch, place, number]`.
    fn describe(&self, features: &Tensor<4>, places: &[usize]) -> Tensor<3> {
        let [batch, channels, rings, columns] = features.dims();
        let places: Vec<i64> = places.iter().map(|place| *place as i64).collect();
        let size = [places.len()];
        let places = Tensor::<1, Int>::from_data(TensorData::new(places, size), &features.device());
        let x = features.clone().reshape([batch, channels, rings * columns]).select(2, places).swap_dims(1, 2);
        let x = self.second.forward(relu(self.first.forward(x)));
        let length = x.clone().square().sum_dim(2).sqrt();
        x / (length + 1e-7)
    }
}

/// Cross entropy of finding, among all places of the question, the one that a place of the answer is at; both `[batch, place, number]`.
fn contrast(answer: Tensor<3>, question: &Tensor<3>) -> Tensor<1> {
    let alike = (answer.clone() * question.clone()).sum_dim(2) / TEMPERATURE;
    let all = answer.matmul(question.clone().swap_dims(1, 2)) / TEMPERATURE;
    let most = all.clone().detach().max_dim(2);
    let total = (all - most.clone()).exp().sum_dim(2).log() + most;
    (total - alike).mean()
}

#[cfg(test)]
mod tests {
    use super::super::layers::CUTS_GAIN;
    use super::*;
    use burn::tensor::Distribution;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn the_papers_heads_have_the_papers_weights() {
        assert_eq!(PatchHeads::new(&[2, 128, 256, 256, 256], CUTS_GAIN, &Device::flex()).num_params(), 560_128);
    }

    #[test]
    fn contrast_is_the_cross_entropy_of_the_right_place() {
        let device = Device::flex();
        let unit = |x: f32| [x.cos(), x.sin()];
        let (answers, questions) = ([0.1f32, 0.9], [0.0f32, 1.2]);
        let tensor = |x: [f32; 2]| {
            let values: Vec<f32> = x.into_iter().flat_map(unit).collect();
            Tensor::<3>::from_data(TensorData::new(values, [1, 2, 2]), &device)
        };
        // By hand: cosines of the angles between, over the temperature.
        let expected: f64 = (0..2)
            .map(|i| {
                let alike = |j: usize| f64::from((answers[i] - questions[j]).cos()) / TEMPERATURE;
                (alike(0).exp() + alike(1).exp()).ln() - alike(i)
            })
            .sum::<f64>()
            / 2.0;
        let found = contrast(tensor(answers), &tensor(questions)).into_scalar::<f32>();
        assert!((f64::from(found) - expected).abs() < 1e-4, "{found} {expected}");
    }

    #[test]
    fn heads_take_batches_of_any_size() {
        let device = Device::flex();
        device.seed(7);
        let features = |batch| vec![Tensor::<4>::random([batch, 6, 4, 8], Distribution::Normal(0.0, 1.0), &device)];
        let heads = PatchHeads::new(&[6], CUTS_GAIN, &device);
        let (answer, question) = (features(3), features(3));
        let places = Places::draw(&question, 16, &mut ChaCha8Rng::seed_from_u64(2));
        let of = |x: &[Tensor<4>], i: usize| vec![x[0].clone().slice(burn::tensor::s![i..i + 1, .., .., ..])];
        let one = |i| heads.loss(&of(&answer, i), &of(&question, i), &places).into_scalar::<f32>();
        let all = heads.loss(&answer, &question, &places).into_scalar::<f32>();
        // Negatives are of the same image alone, so a batch costs what its images cost.
        assert!((all - (0..3).map(one).sum::<f32>() / 3.0).abs() < 1e-5);
    }

    #[test]
    fn an_answer_like_its_question_costs_less_than_another() {
        let device = Device::flex();
        device.seed(4);
        let features = || vec![Tensor::<4>::random([2, 6, 8, 16], Distribution::Normal(0.0, 1.0), &device)];
        // Xavier's tiny weights: directions, not lengths, are compared.
        let heads = PatchHeads::new(&[6], CUTS_GAIN, &device);
        let (question, other) = (features(), features());
        let places = Places::draw(&question, 64, &mut ChaCha8Rng::seed_from_u64(1));
        let loss = |answer: &[Tensor<4>]| heads.loss(answer, &question, &places).into_scalar::<f32>();
        assert!(loss(&question) < 0.8 * loss(&other), "{} {}", loss(&question), loss(&other));
        assert_eq!(Places::draw(&question, 1000, &mut ChaCha8Rng::seed_from_u64(1)).0[0].len(), 128);
    }
}
