//! The way down of a generator.

use burn::module::Module;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use super::blur::halve;
use super::border::Border;
use super::residual::{Block, Stage};
use super::resnet::{HALVINGS, ResnetConfig};

/// What an encoder makes of an image.
pub(super) struct Encoded {
    /// Latent features, at a quarter of the image's size.
    pub(super) latent: Tensor<4>,
    /// What is halved, halving by halving.
    pub(super) details: Vec<Tensor<4>>,
}

/// From an image to the latent features at a quarter of its size, up to the block where image and condition are added.
#[derive(Module, Debug)]
pub(super) struct Encoder {
    stem: Stage,
    down: Vec<Stage>,
    blocks: Vec<Block>,
}

impl Encoder {
    /// For images of so many channels.
    pub(super) fn new(config: &ResnetConfig, channels: usize, device: &Device) -> Self {
        let width = config.width;
        Self {
            stem: Stage::new([channels, width], 7, config, device),
            down: (0..HALVINGS).map(|i| Stage::new([width << i, width << (i + 1)], 3, config, device)).collect(),
            blocks: (0..config.joined()).map(|_| Block::new(config, device)).collect(),
        }
    }

    /// `rings` is added to the features of the first convolution.
    pub(super) fn forward(
        &self,
        x: Tensor<4>,
        rings: Option<Tensor<4>>,
        border: Border,
        seen: &mut Vec<Tensor<4>>,
    ) -> Encoded {
        let convolved = self.stem.conv.forward(border.pad(x, 3));
        let told_apart = rings.into_iter().fold(convolved, |x, rings| x + rings);
        let mut x = relu(self.stem.norm.forward(told_apart));
        let mut details = vec![];
        for stage in &self.down {
            let convolved = stage.conv.forward(border.pad(x, 1));
            seen.push(convolved.clone());
            let detail = relu(stage.norm.forward(convolved));
            x = halve(detail.clone(), border);
            details.push(detail);
        }
        for (i, block) in self.blocks.iter().enumerate() {
            x = block.forward(x, border);
            if i == 0 {
                seen.push(x.clone());
            }
        }
        Encoded { latent: x, details }
    }
}
