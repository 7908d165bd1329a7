//! What a translation's training is told: one TOML file; everything that is left out has a default, what is misspelt is refused.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use lidar::Sensor;
use serde::{Deserialize, Serialize};

use super::answer::Reporting;
use super::augment::Augmentation;
use super::domain::Grid;
use super::losses::{Judged, Losses};
use super::schedule::Schedule;
use super::view::{Coding, Unreported};
use crate::backend::Backend;
use crate::config::{DataConfig, load_sensor, read_table};
use crate::network::{Border, COLUMN_MULTIPLE, PatchGanConfig, RangeCode, RangeCoder, ResnetConfig, UNetConfig};

/// How a translation is learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Patches of the answer should show what the same patches of the question show: Haghighi et al. (2023).
    Cls2r,
    /// The way back should lead to the question: Zhu et al., "Unpaired image-to-image translation using cycle-consistent adversarial
    /// networks" (2017).
    CycleGan,
    /// The mirrored question should have the mirrored answer: Fu et al., "Geometry-consistent generative adversarial networks for
    /// one-sided unsupervised domain mapping" (2019).
    GcGan,
    /// The answer should be that of another run's network: Hinton et al., "Distilling the knowledge in a neural network" (2015).
    Distil,
    /// Real scans made to look simulated should become themselves again: what CLS2R with `losses.twins` learns besides its game.
    Paired,
    /// Learned from real scans alone, made to look simulated: Vacek et al., "Learning to predict lidar intensities" (2021).
    UNet,
}

/// A translation's training.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TranslationConfig {
    /// Name of the model.
    pub name: String,
    /// One sentence for the card.
    pub summary: String,
    /// Licence that the weights carry.
    pub licence: String,
    /// Anything else for the card.
    #[serde(default)]
    pub notes: String,
    /// How it is learned.
    pub method: Method,
    /// Folder of the run that is learned from: `distil` is to answer as its network does, all others begin with that network's weights.
    #[serde(default)]
    pub teacher: Option<PathBuf>,
    /// Name of a built-in sensor, or path of a sensor's TOML file.
    pub sensor: String,
    /// Columns of the turn, if other than the sensor's; scans with more are resampled to it.
    #[serde(default)]
    pub columns: Option<usize>,
    /// Columns of the turns that the exported model takes. Where they are n times those that it learns from, or nearly so, each n-th column is
    /// seen as a turn of its own, as coarse as those.
    #[serde(default)]
    pub served_columns: Option<usize>,
    /// What computes the steps.
    #[serde(default)]
    pub backend: Backend,
    /// Seed of the weights, the order of the scans, the augmentation and the ray drop.
    #[serde(default)]
    pub seed: u64,
    /// How networks see ranges.
    #[serde(default)]
    pub range_code: RangeCode,
    /// How networks see rays without a return.
    #[serde(default)]
    pub unreported: Unreported,
    /// Whether the generator says which rays are reported (the paper's ray-drop synthesis), or draws lost rays into the image itself.
    #[serde(default = "yes")]
    pub ray_drop: bool,
    /// Whether simulated scans are taken without the rays that the real ones that are learned from lose to the vehicle that carries the
    /// sensor. A network cannot know where that vehicle is, and would scatter the loss over all azimuths.
    #[serde(default)]
    pub own_vehicle: bool,
    /// The simulated scans' reflectance, if not their own: e^(−a r) with this a, in 1/m, whatever a ray hits. CARLA reports that, its
    /// `atmosphere_attenuation_rate` being 0.004; what simulators mean by intensity differs, and a network only knows what it has seen.
    #[serde(default)]
    pub attenuation_per_m: Option<f64>,
    /// Folder of the segmentation network that labels the real scans, which otherwise have the labels of their files, mostly none: only what
    /// both domains have tells nothing of which one a scan is from.
    #[serde(default)]
    pub labeller: Option<PathBuf>,
    /// The generator.
    #[serde(default)]
    pub generator: ResnetConfig,
    /// The discriminator.
    #[serde(default)]
    pub discriminator: PatchGanConfig,
    /// The network of the method `unet`, in the generator's place.
    #[serde(default)]
    pub unet: UNetConfig,
    /// What is minimised.
    #[serde(default)]
    pub losses: Losses,
    /// How it is minimised.
    #[serde(default)]
    pub schedule: Schedule,
    /// How scans are varied.
    #[serde(default)]
    pub augmentation: Augmentation,
    /// Simulated scans.
    pub simulated: Split,
    /// Real scans.
    pub real: Split,
}

/// Scans of one domain.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// What is learned from.
    pub train: Vec<DataConfig>,
    /// What the best network is chosen on.
    pub validate: Vec<DataConfig>,
    /// What it is scored on, once, at the end.
    pub test: Vec<DataConfig>,
}

/// By how much, as a share, the columns of served turns may be narrower or wider than those that were learned from. Real scans of an HDL-64E
/// show which rays are lost on a grid of 1800 columns, and are served on 2048.
const MOST_COARSER: f64 = 0.2;

fn yes() -> bool {
    true
}

impl TranslationConfig {
    /// Reads and checks a config file, with what it extends.
    pub fn read(path: &Path) -> Result<Self> {
        Self::from_table(read_table(path)?).with_context(|| format!("config {}", path.display()))
    }

    /// Checks a config.
    pub fn from_table(table: toml::Table) -> Result<Self> {
        let config: Self = table.try_into()?;
        config.check()?;
        Ok(config)
    }

    /// The same config, learning from this run where there is one.
    pub fn with_teacher(self, run: Option<PathBuf>) -> Result<Self> {
        let config = Self { teacher: run.or(self.teacher), ..self };
        config.check()?;
        Ok(config)
    }

    /// The config as TOML.
    pub fn to_toml(&self) -> Result<String> {
        Ok(toml::to_string(self)?)
    }

    /// The grid that both domains are brought to.
    pub fn grid(&self) -> Result<Grid> {
        let native = load_sensor(&self.sensor)?;
        let sensor = match self.columns {
            Some(columns) => native.clone().with_columns(columns)?,
            None => native.clone(),
        };
        Ok(Grid { sensor, native, resample: self.columns.is_some() })
    }

    /// The sensor of the exported model, and how many turns of the network it sees one of its own as.
    pub fn served(&self) -> Result<(Sensor, usize)> {
        let Grid { sensor, native, .. } = self.grid()?;
        let columns = sensor.columns();
        let served = self.served_columns.unwrap_or(columns);
        let phases = (served as f64 / columns as f64).round() as usize;
        let coarser = served as f64 / (phases * columns) as f64;
        ensure!(
            phases > 0 && (1.0 - MOST_COARSER..=1.0 + MOST_COARSER).contains(&coarser),
            "served_columns is {served}, expected a multiple of the {columns} that are learned from, within {:.0} %",
            100.0 * MOST_COARSER
        );
        let multiple = phases * self.multiple();
        ensure!(
            served.is_multiple_of(multiple),
            "served_columns is {served}, to be seen as turns of {columns} or nearly so; expected a multiple of {multiple}"
        );
        Ok((native.with_columns(served)?, phases))
    }

    /// How networks see scans, and how their answers lose rays.
    pub fn reporting(&self) -> Result<Reporting> {
        let range = RangeCoder { code: self.range_code, limits_m: self.grid()?.sensor.range_limits_m() };
        Ok(Reporting { coding: Coding { range, unreported: self.unreported }, ray_drop: self.ray_drop })
    }

    /// The generator as it is trained: a cut-out's ends are no neighbours.
    pub fn training_generator(&self) -> Result<ResnetConfig> {
        let whole = self.schedule.crop_columns == self.grid()?.sensor.columns();
        let border = if whole { self.generator.border } else { Border::Mirror };
        Ok(ResnetConfig { border, ..self.generator })
    }

    /// What rings and columns have to be multiples of.
    pub fn multiple(&self) -> usize {
        match self.method {
            Method::UNet => COLUMN_MULTIPLE,
            Method::Cls2r | Method::CycleGan | Method::GcGan | Method::Distil | Method::Paired => {
                self.generator.multiple()
            }
        }
    }

    /// Whether it is learned by a game against a discriminator.
    fn plays(&self) -> bool {
        matches!(self.method, Method::Cls2r | Method::CycleGan | Method::GcGan)
    }

    /// Whether real scans made to look simulated are learned from.
    pub fn has_twins(&self) -> bool {
        self.losses.twins > 0.0 || self.method == Method::Paired
    }

    /// Whether it learns what real scans report where they were made to look simulated; the others never see their answers beside that.
    pub fn learns_pairs(&self) -> bool {
        self.has_twins() || self.method == Method::UNet
    }

    fn check(&self) -> Result<()> {
        let sensor = self.grid()?.sensor;
        let (rings, columns) = (sensor.rings().len(), sensor.columns());
        let s = &self.schedule;
        let multiple = self.multiple();
        for (name, number) in [("rings", rings), ("columns", columns), ("crop_columns", s.crop_columns)] {
            ensure!(
                number > 0 && number.is_multiple_of(multiple),
                "{name}: {number}, expected a multiple of {multiple}"
            );
        }
        ensure!(s.crop_columns <= columns, "crop_columns is {}, the turn has {columns}", s.crop_columns);
        ensure!(s.steps > 0 && s.batch > 0 && s.checkpoint_every > 0, "steps, batch, checkpoint_every must be above 0");
        ensure!(s.learning_rate > 0.0 && s.learning_rate < 1.0, "learning_rate is {}", s.learning_rate);
        ensure!(s.decay > 0.0 && s.decay <= 1.0, "decay is {}, expected more than 0, at most 1", s.decay);
        ensure!((0.0..1.0).contains(&s.average), "average is {}, expected 0 or more, below 1", s.average);
        ensure!(s.clip_norm > 0.0, "clip_norm is {}", s.clip_norm);
        ensure!(self.teacher.is_none() || self.method != Method::UNet, "teacher: a U-Net learns from no other run");
        ensure!(
            self.ray_drop || self.method != Method::Paired,
            "method paired: without ray_drop there is nothing to learn"
        );
        let twins = self.losses.twins;
        ensure!(
            twins == 0.0 || (twins > 0.0 && twins.is_finite() && self.plays() && self.ray_drop),
            "losses.twins is {twins}: only games with ray drop (cls2r, cyclegan, gcgan) are told by twins, which weigh 0 or more"
        );
        ensure!(
            self.losses.judged == Judged::Simulated || twins > 0.0,
            "losses.judged = \"with_twins\": there are none; expected losses.twins above 0"
        );
        self.served()?;
        let told_apart = self.generator.rings;
        ensure!(
            told_apart == 0 || told_apart == rings,
            "generator.rings is {told_apart}, expected the sensor's {rings}, or 0 for rings that are treated alike"
        );
        let reach = self.generator.range_reach;
        ensure!(reach > 0.0 && reach <= 2.0, "generator.range_reach is {reach}, expected more than 0, at most 2");
        ensure!(
            !self.generator.relief || self.unreported == Unreported::MinusOne,
            "generator.relief: rays without a return have to differ from all returns; expected unreported = \"minus_one\""
        );
        ensure!(
            !self.generator.scatter || !matches!(self.method, Method::UNet | Method::Distil),
            "generator.scatter: a U-Net has none, and a teacher's answers show none; expected another method"
        );
        let d = &self.discriminator;
        for (name, gain) in [("generator", self.generator.gain), ("discriminator", d.gain)] {
            ensure!(gain > 0.0 && gain <= 10.0, "{name}.gain is {gain}, expected more than 0, at most 10");
        }
        ensure!((1..=6).contains(&d.halvings), "discriminator.halvings is {}, expected 1 to 6", d.halvings);
        for (name, number) in [("rings", rings), ("crop_columns", s.crop_columns)] {
            ensure!(
                !self.plays() || d.fits(number),
                "{name}: {number} hold no patch of the discriminator; give it fewer halvings than {}",
                d.halvings
            );
        }
        let unlabelled = self.augmentation.unlabelled_share;
        ensure!((0.0..=1.0).contains(&unlabelled), "unlabelled_share is {unlabelled}, expected 0 to 1");
        if let Some(rate) = self.attenuation_per_m {
            ensure!((0.0..=1.0).contains(&rate), "attenuation_per_m is {rate}, expected 0 to 1");
        }
        ensure!(self.losses.patches > 1, "patches is {}: one patch has no others to be told from", self.losses.patches);
        for (domain, name) in [(&self.simulated, "simulated"), (&self.real, "real")] {
            for (list, part) in [(&domain.train, "train"), (&domain.validate, "validate"), (&domain.test, "test")] {
                ensure!(!list.is_empty(), "no [[{name}.{part}]] data");
                for data in list {
                    let path = data.path.display();
                    ensure!(data.sector_deg.is_none(), "{path}: sector_deg: translations take whole turns");
                    ensure!(
                        name == "simulated" || data.drops_observed,
                        "{path}: empty pixels of motion-compensated scans are artefacts, and would be learned"
                    );
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(extra: &str, real: &str) -> String {
        let data = |table: &str| format!("[[{table}]]\npath = \"a\"\nsource = \"made up\"\nlicence = \"MIT\"\n");
        let parts = ["train", "validate", "test"];
        let simulated: String = parts.iter().map(|part| data(&format!("simulated.{part}"))).collect();
        let reals: String = parts.iter().map(|part| data(&format!("real.{part}")) + real).collect();
        format!(
            "name = \"a\"\nsummary = \"a\"\nlicence = \"MIT\"\nsensor = \"hdl64e\"\nmethod = \"cls2r\"\n{extra}\n{simulated}{reals}"
        )
    }

    fn parse(text: &str) -> Result<TranslationConfig> {
        TranslationConfig::from_table(toml::from_str(text)?)
    }

    fn refusal(extra: &str, real: &str) -> String {
        parse(&text(extra, real)).map_or_else(|e| format!("{e:#}"), |_| String::new())
    }

    #[test]
    fn configs_that_would_mislead_are_refused() {
        assert_eq!(refusal("", ""), "");
        for (extra, word) in [
            ("columns = 510", "columns: 510"),
            ("[schedule]\ncrop_columns = 2052", "the turn has 2048"),
            ("[schedule]\naverage = 1.0", "average"),
            ("columns = 512\nserved_columns = 640", "served_columns is 640, expected a multiple of the 512"),
            ("columns = 512\nserved_columns = 2008", "served_columns is 2008, to be seen as turns of 512"),
            ("columns = 512\nserved_columns = 100", "served_columns is 100, expected"),
            ("[losses]\npatches = 1", "patches"),
            ("[losses]\ntwins = -1.0", "losses.twins is -1"),
            ("ray_drop = false\n[losses]\ntwins = 1.0", "only games with ray drop"),
            ("[losses]\njudged = \"with_twins\"", "expected losses.twins above 0"),
            ("attenuation_per_m = -0.1", "attenuation_per_m is -0.1"),
            ("[generator]\nrings = 32", "generator.rings is 32"),
            ("unreported = \"zero\"\n[generator]\nrelief = true", "expected unreported = \"minus_one\""),
            ("[generator]\ngain = 0.0", "generator.gain is 0"),
            ("[discriminator]\ngain = 11.0", "discriminator.gain is 11"),
            ("[generator]\nwidht = 3", "widht"),
            ("[discriminator]\nhalvings = 5", "rings: 64 hold no patch"),
        ] {
            assert!(refusal(extra, "").contains(word), "{extra}: {}", refusal(extra, ""));
        }
        let scattering = text("[generator]\nscatter = true", "");
        assert!(parse(&scattering).is_ok());
        for method in ["unet", "distil"] {
            let refused =
                parse(&scattering.replace("cls2r", method)).map_or_else(|e| format!("{e:#}"), |_| String::new());
            assert!(refused.contains("generator.scatter"), "{method}: {refused}");
        }
        assert!(refusal("", "drops_observed = false\n").contains("artefacts"));
        assert!(refusal("", "sector_deg = [90.0, 0.0]\n").contains("whole turns"));
    }

    #[test]
    fn served_turns_are_seen_as_coarse_as_those_that_were_learned_from_or_nearly_so() -> Result<()> {
        for (columns, served, phases) in [(512, 2048, 4), (1800, 2048, 1), (512, 2000, 4), (1024, 1024, 1)] {
            let (sensor, found) =
                parse(&text(&format!("columns = {columns}\nserved_columns = {served}"), ""))?.served()?;
            assert_eq!((sensor.columns(), found), (served, phases), "{columns}");
        }
        Ok(())
    }

    #[test]
    fn a_config_survives_its_toml() -> Result<()> {
        let config = parse(&text("", ""))?;
        assert_eq!(parse(&config.to_toml()?)?.to_toml()?, config.to_toml()?);
        Ok(())
    }
}
