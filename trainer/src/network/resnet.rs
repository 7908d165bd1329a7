//! The generator of CUT, conditioned as CLS2R has it: G(d, c) = `G_dec`(`G_enc`(d) + E(c)).
//!
//! Park et al., "Contrastive learning for unpaired image-to-image translation" (2020); Haghighi et al., "Contrastive learning-based
//! framework for sim-to-real mapping of lidar point clouds in autonomous driving systems" (2023).

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::{Device, Tensor, s};
use serde::{Deserialize, Serialize};

use super::blur::double;
use super::border::Border;
use super::encoder::{Encoded, Encoder};
use super::generated::Generated;
use super::layers::{CUTS_GAIN, conv};
use super::norm::NormKind;
use super::relief::{RELIEF_CHANNELS, with_relief};
use super::residual::{Block, Stage};
use super::rings::Rings;
use super::scatter::scale;

/// Channels of a range image as the generator is given it and gives it: range code and reflectance, −1 to 1; it gives a logit of the ray drop
/// besides.
pub const IMAGE_CHANNELS: usize = 2;

/// Halvings of the image: rings and columns have to be multiples of 2 to the power of it.
pub(super) const HALVINGS: usize = 2;

/// Size of a [`Resnet`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[expect(clippy::struct_excessive_bools, reason = "parts that a network has or has not, each whatever the others are")]
pub struct ResnetConfig {
    /// Channels of the images, no config's to say: a range image has [`IMAGE_CHANNELS`].
    #[serde(skip)]
    pub channels: usize,
    /// Channels of the first layer; the papers' ngf.
    pub width: usize,
    /// Residual blocks.
    pub blocks: usize,
    /// What keeps features in bounds.
    pub norm: NormKind,
    /// What Xavier's weights are multiplied by to begin with; the last layer's always by CUT's 0.02, so that a [correction](Output::Correction)
    /// begins near nothing. With 0.02 features are about as small as the ε of the norms, and Adam, which moves weights by as much however
    /// small they are, moves these by all of their size at once: a training of few steps is spent on getting over that. With 1 it is not.
    pub gain: f64,
    /// How the image goes on beyond its edges.
    pub border: Border,
    /// Whether there is an encoder of the semantic labels.
    pub condition: bool,
    /// Rings that the network tells apart, the sensor's; 0: none, as in the papers, where every ring is treated alike.
    pub rings: usize,
    /// Whether what is halved on the image's way down is added again on the way up, as in `LinkNet` (Chaurasia and Culurciello, 2017). The
    /// papers' networks have to pass all that they know of details through a quarter of the image's size.
    pub details: bool,
    /// Whether the network is told beside range code and reflectance how steep surfaces are to the rays that hit them; the papers' have to
    /// find out. It takes a code for rays without a return that no return has, −1.
    pub relief: bool,
    /// Whether the network also says how far reflectances scatter about its own.
    pub scatter: bool,
    /// What the last layer says.
    pub output: Output,
    /// The most that a [correction](Output::Correction) changes a range code by: 0.01 of the logarithmic code are 2.4 % of r + 1 m where a
    /// sensor sees as far as 120 m. A simulator knows where things are; a discriminator that is shown other places would have them moved.
    pub range_reach: f32,
}

/// What the last layer says of range code and reflectance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Output {
    /// Their values, as in the papers: the network has to learn first to show what it is shown.
    #[default]
    Whole,
    /// What is added to those that are shown: the network begins with the scan as it is, and details need not pass its bottleneck.
    Correction,
}

impl Default for ResnetConfig {
    fn default() -> Self {
        Self {
            channels: IMAGE_CHANNELS,
            width: 64,
            blocks: 9,
            norm: NormKind::Instance,
            gain: CUTS_GAIN,
            border: Border::Turn,
            condition: true,
            rings: 0,
            details: false,
            relief: false,
            scatter: false,
            output: Output::Whole,
            range_reach: 1.0,
        }
    }
}

/// The network.
#[derive(Module, Debug)]
pub struct Resnet {
    image: Encoder,
    condition: Option<Encoder>,
    rings: Option<Rings>,
    blocks: Vec<Block>,
    up: Vec<Stage>,
    head: Conv2d,
    #[module(skip)]
    border: Border,
    #[module(skip)]
    details: bool,
    #[module(skip)]
    relief: bool,
    #[module(skip)]
    scatter: bool,
    #[module(skip)]
    output: Output,
    #[module(skip)]
    range_reach: f32,
    #[module(skip)]
    channels: usize,
}

impl ResnetConfig {
    /// A network with random weights.
    pub fn init(&self, device: &Device) -> Resnet {
        let (width, joined) = (self.width, self.joined());
        Resnet {
            image: Encoder::new(self, self.channels + if self.relief { RELIEF_CHANNELS } else { 0 }, device),
            condition: self.condition.then(|| Encoder::new(self, 1, device)),
            rings: (self.rings > 0).then(|| Rings::new(self, device)),
            blocks: (joined..self.blocks).map(|_| Block::new(self, device)).collect(),
            up: (0..HALVINGS).rev().map(|i| Stage::new([width << (i + 1), width << i], 3, self, device)).collect(),
            head: conv([width, self.said()], 7, 0, CUTS_GAIN, device),
            border: self.border,
            details: self.details,
            relief: self.relief,
            scatter: self.scatter,
            output: self.output,
            range_reach: self.range_reach,
            channels: self.channels,
        }
    }

    /// The number of blocks after which image and condition are added: four of nine.
    pub(super) fn joined(&self) -> usize {
        self.blocks / 2
    }

    /// Channels of what the last layer says.
    pub(super) fn said(&self) -> usize {
        self.channels + 1 + usize::from(self.scatter)
    }

    /// What rings and columns have to be multiples of.
    pub fn multiple(&self) -> usize {
        1 << HALVINGS
    }

    /// Channels of each layer of [`Resnet::features`].
    pub fn feature_channels(&self) -> Vec<usize> {
        let deep = self.width << HALVINGS;
        vec![self.channels, self.width << 1, deep, deep, deep]
    }
}

impl Resnet {
    /// The same network, for images that go on beyond their edges like this.
    #[must_use]
    pub fn with_border(mut self, border: Border) -> Self {
        self.border = border;
        self
    }

    /// What a sensor would have measured of `image`, range code and reflectance from −1 to 1, `[batch, 2, ring, column]`, given the
    /// `condition`, its semantic labels from −1 to 1, `[batch, 1, ring, column]`.
    pub fn forward(&self, image: Tensor<4>, condition: &Tensor<4>) -> Generated {
        self.generate(image, condition, &mut vec![])
    }

    /// [`forward`](Self::forward), and the [`features`](Self::features) that are passed on the way.
    pub fn forward_with_features(&self, image: Tensor<4>, condition: &Tensor<4>) -> (Generated, Vec<Tensor<4>>) {
        let mut features = vec![self.border.pad(image.clone(), 3)];
        let generated = self.generate(image, condition, &mut features);
        (generated, features)
    }

    /// The features that patches are compared by: the image itself, the two convolutions on the way down, the first block, and the first
    /// one that knows the condition: CUT's layers 0, 4, 8, 12 and 16.
    pub fn features(&self, image: Tensor<4>, condition: &Tensor<4>) -> Vec<Tensor<4>> {
        let mut features = vec![self.border.pad(image.clone(), 3)];
        self.latent(image, condition, &mut features);
        features
    }

    fn generate(&self, image: Tensor<4>, condition: &Tensor<4>, seen: &mut Vec<Tensor<4>>) -> Generated {
        let Encoded { latent: mut x, mut details } = self.latent(image.clone(), condition, seen);
        for block in self.blocks.iter().skip(1) {
            x = block.forward(x, self.border);
        }
        for stage in &self.up {
            let doubled = double(x, self.border);
            let detail = details.pop().filter(|_| self.details);
            x = stage.forward(detail.into_iter().fold(doubled, |x, detail| x + detail), self.border);
        }
        let x = self.head.forward(self.border.pad(x, 3));
        let x = self.rings.iter().fold(x, |x, rings| x + rings.head.val());
        let channels = |from: usize, to: usize| x.clone().slice(s![.., from..to, .., ..]);
        let keep = self.channels;
        let said = channels(0, keep);
        let image = match self.output {
            Output::Whole => said.tanh(),
            Output::Correction => {
                image + Tensor::cat(vec![channels(0, 1).tanh() * self.range_reach, channels(1, keep)], 1)
            }
        };
        let scatter = self.scatter.then(|| scale(channels(keep + 1, keep + 2)));
        Generated { image, keep_logit: channels(keep, keep + 1), scatter }
    }

    /// The latent features after the first block that knows the condition, and what of the image was halved before; they and those that are
    /// passed on the way are appended to `seen`.
    fn latent(&self, image: Tensor<4>, condition: &Tensor<4>, seen: &mut Vec<Tensor<4>>) -> Encoded {
        let rings = self.rings.as_ref().map(|rings| rings.stem.val());
        let image = if self.relief { with_relief(image, self.border) } else { image };
        let Encoded { latent: x, details } = self.image.forward(image, rings, self.border, seen);
        let x = match &self.condition {
            None => x,
            Some(encoder) => x + encoder.forward(condition.clone(), None, self.border, &mut vec![]).latent,
        };
        let x = match self.blocks.first() {
            None => x,
            Some(block) => block.forward(x, self.border),
        };
        seen.push(x.clone());
        Encoded { latent: x, details }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::module::Param;
    use burn::tensor::Distribution;

    fn small(border: Border) -> ResnetConfig {
        ResnetConfig { width: 4, blocks: 4, border, ..ResnetConfig::default() }
    }

    fn scan(device: &Device) -> (Tensor<4>, Tensor<4>) {
        device.seed(5);
        let uniform = |channels| Tensor::<4>::random([2, channels, 16, 64], Distribution::Uniform(-1.0, 1.0), device);
        (uniform(2), uniform(1))
    }

    #[test]
    fn the_papers_network_has_the_papers_weights() {
        let device = Device::flex();
        let without = ResnetConfig { condition: false, ..ResnetConfig::default() }.init(&device).num_params();
        let with = ResnetConfig::default().init(&device).num_params();
        // 11.375 million of CUT's resnet_9blocks, 5.09 million of the condition's encoder.
        assert_eq!((without, with - without), (11_375_043, 5_092_864));
    }

    #[test]
    fn turning_the_sensor_turns_the_answer() {
        let device = Device::flex();
        let network = ResnetConfig { details: true, relief: true, ..small(Border::Turn) }.init(&device);
        let (image, condition) = scan(&device);
        let turn =
            |x: Tensor<4>| Tensor::cat(vec![x.clone().slice(s![.., .., .., 8..64]), x.slice(s![.., .., .., 0..8])], 3);
        let logit = |image, condition| network.forward(image, &condition).keep_logit;
        let difference =
            turn(logit(image.clone(), condition.clone())) - logit(turn(image.clone()), turn(condition.clone()));
        assert!(difference.abs().max().into_scalar::<f32>() < 1e-5);
    }

    #[test]
    fn details_pass_beside_the_bottleneck_where_that_is_asked_for() {
        let device = Device::flex();
        // What alternates from column to column is gone at half the size: blur-pools see to that.
        let column = Tensor::<4>::zeros([1, 2, 16, 1], &device);
        let image = Tensor::cat((0..32).map(|i| column.clone() + (i % 2) as f32).collect(), 3);
        let condition = image.clone().slice(s![.., 0..1]) * 0.0;
        let alternates = |details: bool| {
            let network = ResnetConfig { details, ..small(Border::Turn) }.init(&device);
            let logit = network.forward(image.clone(), &condition).keep_logit;
            let neighbour = logit.clone().slice(s![.., .., .., 1..]) - logit.slice(s![.., .., .., 0..31]);
            neighbour.abs().max().into_scalar::<f32>()
        };
        assert!(alternates(false) < 1e-7 && alternates(true) > 1e-6, "{} {}", alternates(false), alternates(true));
    }

    #[test]
    fn features_on_the_way_are_those_without_the_rest_of_it() {
        let device = Device::flex();
        let network = small(Border::Mirror).init(&device);
        let (image, condition) = scan(&device);
        let (generated, on_the_way) = network.forward_with_features(image.clone(), &condition);
        let logit = network.forward(image.clone(), &condition).keep_logit;
        assert_eq!((generated.keep_logit - logit).abs().max().into_scalar::<f32>(), 0.0);
        for (a, b) in on_the_way.into_iter().zip(network.features(image, &condition)) {
            assert_eq!((a - b).abs().max().into_scalar::<f32>(), 0.0);
        }
    }

    #[test]
    fn a_network_that_corrects_begins_near_the_scan_itself() {
        let device = Device::flex();
        let (image, condition) = scan(&device);
        let off = |output: Output| {
            let network = ResnetConfig { output, ..small(Border::Turn) }.init(&device);
            let image_out = network.forward(image.clone(), &condition).image;
            (image_out - image.clone()).abs().max().into_scalar::<f32>()
        };
        // Of 300 draws of the weights the most was 0.12, and the least 1.0.
        assert!(off(Output::Correction) < 0.25 && off(Output::Whole) > 0.5);
    }

    #[test]
    fn all_weights_but_the_last_layers_begin_as_large_as_is_asked_for() {
        let device = Device::flex();
        let spread = |conv: &Conv2d| conv.weight.val().square().mean().sqrt().into_scalar::<f32>();
        let [small, large] =
            [CUTS_GAIN, 1.0].map(|gain| ResnetConfig { gain, ..ResnetConfig::default() }.init(&device));
        let ratio = |conv: fn(&Resnet) -> &Conv2d| spread(conv(&large)) / spread(conv(&small));
        assert!((ratio(|network| &network.up[0].conv) - 50.0).abs() < 2.0);
        assert!((ratio(|network| &network.head) - 1.0).abs() < 0.1);
    }

    #[test]
    fn a_correction_moves_ranges_no_further_than_it_may() {
        let device = Device::flex();
        let (image, condition) = scan(&device);
        let config = ResnetConfig { output: Output::Correction, range_reach: 0.01, ..small(Border::Turn) };
        let mut network = config.init(&device);
        network.head = conv([4, IMAGE_CHANNELS + 1], 7, 0, CUTS_GAIN, &device).map(&mut Louder);
        let moved = (network.forward(image.clone(), &condition).image - image).abs();
        let most = |channel: usize| moved.clone().slice(s![.., channel..=channel]).max().into_scalar::<f32>();
        assert!(most(0) <= 0.010_001 && most(0) > 0.009 && most(1) > 0.1, "{} {}", most(0), most(1));
    }

    #[test]
    fn rings_are_told_apart_where_that_is_asked_for_and_columns_never_are() {
        let device = Device::flex();
        // The same everywhere: whatever differs in the answer is the network's own.
        let image = Tensor::<4>::zeros([1, 2, 16, 32], &device) + 0.3;
        let condition = image.clone().slice(s![.., 0..1]);
        let spread = |rings: usize, along: usize| {
            device.seed(3);
            let mut network = ResnetConfig { rings, ..small(Border::Turn) }.init(&device);
            network.rings = network.rings.map(|rings| rings.map(&mut Shuffled));
            let logit = network.forward(image.clone(), &condition).keep_logit;
            (logit.clone().max_dim(along) - logit.min_dim(along)).max().into_scalar::<f32>()
        };
        assert!(spread(0, 2) < 1e-5, "{}", spread(0, 2));
        assert!(spread(16, 2) > 0.1 && spread(16, 3) < 1e-5, "{} {}", spread(16, 2), spread(16, 3));
    }

    /// Random weights.
    struct Shuffled;

    impl burn::module::ModuleMapper for Shuffled {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            param.map(|x| x.random_like(Distribution::Normal(0.0, 1.0)))
        }
    }

    /// Weights a thousand times as large.
    struct Louder;

    impl burn::module::ModuleMapper for Louder {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            param.map(|x| x * 1e3)
        }
    }

    #[test]
    fn features_are_those_of_the_papers_layers_and_the_last_knows_the_condition() {
        let device = Device::flex();
        for border in [Border::Turn, Border::Mirror] {
            let config = small(border);
            let network = config.init(&device);
            let (image, condition) = scan(&device);
            let features = network.features(image.clone(), &condition);
            let sizes: Vec<[usize; 4]> = features.iter().map(Tensor::dims).collect();
            let expected = [[2, 2, 22, 70], [2, 8, 16, 64], [2, 16, 8, 32], [2, 16, 4, 16], [2, 16, 4, 16]];
            assert_eq!(sizes, expected);
            assert_eq!(config.feature_channels(), expected.map(|size| size[1]));
            let others = network.features(image, &(condition * -1.0));
            let differ = |i: usize| (features[i].clone() - others[i].clone()).abs().max().into_scalar::<f32>() > 1e-6;
            assert!((0..4).all(|i| !differ(i)) && differ(4));
        }
    }
}
