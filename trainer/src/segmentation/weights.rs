//! The trained network in its folder: `network.bpk`, `card.json`, and `card.md` for people. No `model.onnx`: a server that lists its
//! models does not see it.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use burn::tensor::{Device, Tensor};
use lidar::{RangeImage, Sensor};
use proto::card::Dataset;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::classes::{CLASSES, COMMONEST, NAMES, merged};
use super::darknet::{Darknet, DarknetConfig};
use super::input;
use super::score::{Confusion, SegmentationScore};
use crate::data::scans::hex;
use crate::network::Border;
use crate::train::checkpoint;

/// Version of the card that this code writes and reads.
const SCHEMA: u32 = 1;

/// File names in the folder.
const WEIGHTS: &str = "network.bpk";
const CARD: &str = "card.json";

/// A trained network and its card.
#[derive(Clone, Debug)]
pub struct Segmentation {
    /// The network, on the device that it was loaded for.
    pub network: Darknet,
    /// What it is.
    pub card: SegmentationCard,
}

/// What a segmentation network is, was trained on and scored.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SegmentationCard {
    /// Version of this card.
    pub schema: u32,
    /// What it is, in a sentence.
    pub summary: String,
    /// Licence that the weights carry.
    pub licence: String,
    /// Anything else.
    pub notes: String,
    /// The sensor whose scans it was trained on.
    pub sensor: Sensor,
    /// Size of the network.
    pub network: DarknetConfig,
    /// Names of the classes, by channel.
    pub classes: Vec<String>,
    /// Of `network.bpk`.
    pub weights_sha256: String,
    /// What it learned from.
    pub trained_on: Vec<Dataset>,
    /// How well it does on scans that it did not learn from.
    pub scores: Vec<SegmentationScore>,
}

impl SegmentationCard {
    /// A card without weights and scores yet.
    pub fn new(summary: &str, licence: &str, notes: &str, sensor: Sensor, network: DarknetConfig) -> Self {
        Self {
            schema: SCHEMA,
            summary: summary.into(),
            licence: licence.into(),
            notes: notes.into(),
            sensor,
            network,
            classes: NAMES.iter().map(ToString::to_string).collect(),
            weights_sha256: String::new(),
            trained_on: vec![],
            scores: vec![],
        }
    }
}

impl Segmentation {
    /// Reads a network. Missing or damaged weights are an error, as are those of another network.
    pub fn load(folder: &Path, device: &Device) -> Result<Self> {
        let path = folder.join(CARD);
        let text = std::fs::read_to_string(&path).with_context(|| {
            format!("no segmentation network in {}: cannot read {}", folder.display(), path.display())
        })?;
        let card: SegmentationCard = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        ensure!(card.schema == SCHEMA, "{}: schema is {}, expected {SCHEMA}", path.display(), card.schema);
        ensure!(card.classes == NAMES, "{}: its classes are {:?}, expected {NAMES:?}", path.display(), card.classes);
        let path = folder.join(WEIGHTS);
        let bytes = std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let found = hex(&Sha256::digest(&bytes));
        ensure!(
            found == card.weights_sha256,
            "{}: SHA-256 is {found}, the card says {}: the file is damaged or another network's",
            path.display(),
            card.weights_sha256
        );
        let network = checkpoint::load_network(&path, card.network.init(device))?;
        Ok(Self { network, card })
    }

    /// Writes the folder: the weights first, so that a card never speaks of weights that are not there.
    pub fn save(&mut self, folder: &Path) -> Result<()> {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let path = folder.join(WEIGHTS);
        checkpoint::save_network(&path, &self.network)?;
        self.card.weights_sha256 = hex(&Sha256::digest(std::fs::read(&path)?));
        lidar::formats::write_atomically(&folder.join(CARD), &serde_json::to_vec_pretty(&self.card)?)?;
        lidar::formats::write_atomically(&folder.join("card.md"), self.card.to_markdown().as_bytes())?;
        Ok(())
    }

    /// The class of each return, `[ring, column]`; of what has none, something.
    pub fn classes(&self, image: &RangeImage, sensor: &Sensor, device: &Device) -> Vec<usize> {
        let logits = self.network.forward(input::tensor([image], sensor, device), Border::Turn);
        logits.argmax(1).into_data().iter::<i64>().map(|class| class as usize).collect()
    }

    /// The same scan with the classes that the network sees in it: seen on the grid that it learned on, and brought back to each return from the
    /// one nearest in range of those beside it on its ring.
    pub fn labelled(&self, image: &RangeImage, sensor: &Sensor, device: &Device) -> RangeImage {
        let (fine, coarse) = (image.columns(), self.card.sensor.columns());
        let picked = image.pick_columns(coarse);
        let seen = self.classes(&picked, sensor, device);
        let class = (0..image.range_m().len()).map(|i| {
            let (ring, column, range_m) = (i / fine, i % fine, image.range_m()[i]);
            let beside = |shift: usize| ring * coarse + (column * coarse / fine + coarse + shift - 1) % coarse;
            let off = |i: &usize| (picked.range_m()[*i] - range_m).abs();
            let nearest = [1, 0, 2]
                .map(beside)
                .into_iter()
                .filter(|i| picked.range_m()[*i] > 0.0)
                .min_by(|a, b| off(a).total_cmp(&off(b)));
            nearest.map_or(0, |i| COMMONEST[seen[i]])
        });
        let (range_m, reflectance) = (image.range_m().to_vec(), image.reflectance().to_vec());
        RangeImage::from_channels(fine, range_m, reflectance, class.collect())
    }

    /// Scores it on labelled scans.
    pub fn score(&self, of: &str, images: &[RangeImage], sensor: &Sensor, device: &Device) -> SegmentationScore {
        let mut confusion = Confusion::default();
        for image in images {
            for (predicted, class) in self.classes(image, sensor, device).into_iter().zip(image.class()) {
                if let Some(truth) = merged(*class) {
                    confusion.add(truth, predicted);
                }
            }
        }
        confusion.score(of, images.len())
    }

    /// What the network sees in a scan: its bottleneck, `[channel, ring / 8, column / 16]`.
    pub fn features(&self, image: &RangeImage, sensor: &Sensor, device: &Device) -> Tensor<3> {
        self.network.bottleneck(input::tensor([image], sensor, device), Border::Turn).squeeze_dim(0)
    }
}

impl SegmentationCard {
    /// The card for people.
    pub fn to_markdown(&self) -> String {
        // Writing into a string cannot fail.
        let mut out = format!(
            "# Segmentation\n\n{}.\n\n- Licence: {}\n- Sensor: {}, {} rings × {} columns\n- Weights: `{WEIGHTS}`, a Burn record; SHA-256 `{}…`\n",
            self.summary.trim_end_matches('.'),
            self.licence,
            self.sensor.name,
            self.sensor.rings().len(),
            self.sensor.columns(),
            &self.weights_sha256[..16.min(self.weights_sha256.len())],
        );
        if !self.notes.is_empty() {
            let _ = write!(out, "\n{}\n", self.notes);
        }
        out += "\n## Learned from\n\n| data | licence | scans | SHA-256 |\n|---|---|---|---|\n";
        for d in &self.trained_on {
            // Streets have no files: the config's seed says which they are.
            let sha256 = d.sha256.get(..16).map_or_else(|| "–".into(), |start| format!("`{start}…`"));
            let _ = writeln!(out, "| {} | {} | {} | {sha256} |", d.name, d.licence, d.scans);
        }
        out += "\n## Held-out scores\n\n| scans | number | pixel accuracy | mean IoU |";
        for name in NAMES {
            let _ = write!(out, " {name} |");
        }
        out += "\n|---|---|---|---|";
        out += &"---|".repeat(CLASSES);
        for s in &self.scores {
            let _ = write!(out, "\n| {} | {} | {:.3} | {:.3} |", s.of, s.scans, s.pixel_accuracy, s.mean_iou);
            for name in NAMES {
                let _ = match s.iou.iter().find(|(n, _)| n == name) {
                    Some((_, iou)) => write!(out, " {iou:.2} |"),
                    None => write!(out, " – |"),
                };
            }
        }
        out.push('\n');
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small(seed: u64) -> Result<Segmentation> {
        let device = Device::flex();
        device.seed(seed);
        let config = DarknetConfig { channels: [2, 2, 4, 4, 4] };
        let network = config.init(&device);
        let sensor = Sensor::builtin("vlp16")?.with_columns(64)?;
        Ok(Segmentation { network, card: SegmentationCard::new("A test", "MIT", "", sensor, config) })
    }

    #[test]
    fn damaged_or_missing_weights_are_an_error_never_a_network() -> Result<()> {
        let folder = tempfile::tempdir()?;
        let message = || match Segmentation::load(folder.path(), &Device::flex()) {
            Ok(_) => String::new(),
            Err(error) => format!("{error:#}"),
        };
        assert!(message().contains("no segmentation network in"), "{}", message());
        small(1)?.save(folder.path())?;
        assert_eq!(message(), "");
        let path = folder.path().join(WEIGHTS);
        let mut bytes = std::fs::read(&path)?;
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(&path, &bytes)?;
        assert!(message().contains("damaged"), "{}", message());
        std::fs::remove_file(&path)?;
        assert!(message().contains("cannot read"), "{}", message());
        Ok(())
    }

    #[test]
    fn labels_come_back_to_the_returns_that_they_were_seen_at() -> Result<()> {
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/segmentation/1");
        let segmentation = Segmentation::load(&shipped, &Device::flex())?;
        let sensor = &segmentation.card.sensor;
        let columns = sensor.columns();
        // The ground below, a wall around. Every pixel of the coarse grid is four of the fine one: the third is seen, the second lost.
        let mut image = RangeImage::empty(sensor.rings().len(), 4 * columns);
        for i in (0..image.range_m().len()).filter(|i| i % 4 != 1) {
            let down = -sensor.rings()[i / (4 * columns)].elevation_rad.sin();
            image.set(i, if down > 0.1 { 1.7 / down as f32 } else { 17.0 }, 0.3, 0);
        }
        let seen = segmentation.classes(&image.pick_columns(columns), sensor, &Device::flex());
        let labelled = segmentation.labelled(&image, sensor, &Device::flex());
        assert_eq!((labelled.range_m(), labelled.reflectance()), (image.range_m(), image.reflectance()));
        for (i, class) in labelled.class().iter().enumerate() {
            // Within a ring all ranges are alike: the own pixel comes first.
            assert_eq!(*class, if i % 4 == 1 { 0 } else { COMMONEST[seen[i / 4]] }, "{i}");
        }
        assert!(seen.iter().any(|class| *class != seen[0]), "the classes differ");
        Ok(())
    }

    #[test]
    fn a_network_comes_back_from_its_folder_as_it_was() -> Result<()> {
        let folder = tempfile::tempdir()?;
        let mut saved = small(2)?;
        saved.save(folder.path())?;
        let loaded = Segmentation::load(folder.path(), &Device::flex())?;
        let mut image = RangeImage::empty(16, 64);
        (0..16 * 64).for_each(|i| image.set(i, 1.0 + i as f32 / 40.0, 0.3, 0));
        let sensor = &saved.card.sensor;
        let classes = |s: &Segmentation| s.classes(&image, sensor, &Device::flex());
        assert_eq!(classes(&loaded), classes(&saved));
        assert!(loaded.card.to_markdown().contains("VLP-16"));
        Ok(())
    }
}
